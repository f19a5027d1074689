//! Outlines of soles, EU size 42, in foot coordinates: tables of the medial and the lateral edge, with straight lines between
//! their rows.
//!
//! The two outlines differ deliberately: [`REFERENCE_INSOLE`] is the sheet that is cut for the device, and [`GENERIC_SOLE`] is
//! the sole of the computed recordings of `tools/recording` and of drawings on screens. At the toes their widths differ by up
//! to 12 mm at the same fraction of the length. The positions of cells are computed from the outlines, so a change of an
//! outline changes the layout.

/// The outline of a sole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    /// Rows from the heel to the tip of the toes: y, and x of the medial and of the lateral edge there, mm. y increases from 0.
    pub rows_mm: &'static [[f64; 3]],
}

/// The reference insole of `firmware::layout`. It imitates a common insole of this size and is not a measured outline.
pub const REFERENCE_INSOLE: Outline = Outline {
    rows_mm: &[
        [0.0, 30.0, 60.0],
        [13.5, 20.0, 70.0],
        [32.4, 14.0, 77.0],
        [59.4, 14.0, 79.0],
        [94.5, 19.0, 83.0],
        [129.6, 16.0, 90.0],
        [162.0, 7.0, 96.0],
        [183.6, 2.0, 98.0],
        [199.8, 0.0, 97.0],
        [221.4, 2.0, 91.0],
        [243.0, 7.0, 79.0],
        [259.2, 16.0, 62.0],
        [270.0, 26.0, 46.0],
    ],
};

/// A generic sole, for computed recordings, and for drawings of a foot if the positions of the cells are not known.
pub const GENERIC_SOLE: Outline = Outline {
    rows_mm: &[
        [0.0, 24.0, 52.0],
        [10.0, 13.0, 63.0],
        [30.0, 7.0, 70.0],
        [60.0, 8.0, 72.0],
        [100.0, 15.0, 77.0],
        [130.0, 16.0, 83.0],
        [160.0, 10.0, 90.0],
        [190.0, 2.0, 95.0],
        [205.0, 0.0, 96.0],
        [225.0, 1.0, 92.0],
        [245.0, 6.0, 82.0],
        [258.0, 13.0, 69.0],
        [266.0, 24.0, 53.0],
        [268.0, 30.0, 46.0],
    ],
};

impl Outline {
    /// Length from the back of the heel to the tip of the toes, mm.
    pub const fn length_mm(&self) -> f64 {
        self.rows_mm[self.rows_mm.len() - 1][0]
    }

    /// Largest x of the lateral edge, mm. The medial edge touches 0, so this is the width.
    pub const fn width_mm(&self) -> f64 {
        let mut widest_mm = 0.0;
        let mut row = 0;
        while row < self.rows_mm.len() {
            let [_, _, lateral_mm] = self.rows_mm[row];
            widest_mm = if lateral_mm > widest_mm { lateral_mm } else { widest_mm };
            row += 1;
        }
        widest_mm
    }

    /// x of the medial and of the lateral edge at `y_mm`, mm. For the place at a fraction of the length, pass that fraction of
    /// [`Outline::length_mm`]. Beyond the ends the first or last straight line continues.
    ///
    /// ```
    /// use plantar::pipeline::outline::{GENERIC_SOLE, Outline};
    ///
    /// let [medial_mm, lateral_mm] = GENERIC_SOLE.edges_mm(0.5 * GENERIC_SOLE.length_mm());
    /// assert!(0.0 < medial_mm && lateral_mm < GENERIC_SOLE.width_mm());
    ///
    /// const TRAPEZIUM: Outline = Outline { rows_mm: &[[0.0, 20.0, 60.0], [100.0, 0.0, 90.0]] };
    /// assert_eq!(TRAPEZIUM.edges_mm(50.0), [10.0, 75.0]);
    /// ```
    pub const fn edges_mm(&self, y_mm: f64) -> [f64; 2] {
        let mut after = 1;
        while after < self.rows_mm.len() - 1 && self.rows_mm[after][0] <= y_mm {
            after += 1;
        }
        let ([y0, medial0, lateral0], [y1, medial1, lateral1]) = (self.rows_mm[after - 1], self.rows_mm[after]);
        let share = (y_mm - y0) / (y1 - y0);
        [medial0 + (medial1 - medial0) * share, lateral0 + (lateral1 - lateral0) * share]
    }
}
