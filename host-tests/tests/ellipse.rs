//! Contact ellipses: centre, radii and angle, compared with those of known shapes.

use plantar::Region;
use plantar::insole::Insole;
use plantar::pipeline::contact::WHOLE;
use plantar::pipeline::ellipse::Ellipse;
use plantar::pipeline::region::{AreaMoments, Cell, MAX_DISTANCE_MM, SecondMoments};
use proptest::prelude::*;
use testkit::{LAW, SETUP, cell, code_of, moments};

fn config() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::default() }
}

/// A known ellipse: `r_a_mm` lies in the direction `angle_deg` from x, `r_b_mm` at a right angle to it.
#[derive(Clone, Copy, Debug)]
struct Truth {
    x_mm: f64,
    y_mm: f64,
    r_a_mm: f64,
    r_b_mm: f64,
    angle_deg: f64,
}

impl Truth {
    fn contains(&self, x_mm: f64, y_mm: f64) -> bool {
        let (sin, cos) = self.angle_deg.to_radians().sin_cos();
        let (dx, dy) = (x_mm - self.x_mm, y_mm - self.y_mm);
        let (along, across) = (dx * cos + dy * sin, dy * cos - dx * sin);
        (along / self.r_a_mm).powi(2) + (across / self.r_b_mm).powi(2) <= 1.0
    }

    /// The share of a square cell that the ellipse covers, relative to [`WHOLE`]: the number of covered points of a 16 x 16 grid.
    fn share(&self, x_mm: f32, y_mm: f32, side_mm: f64) -> u16 {
        let at = |i: usize| ((i % 16) as f64 / 16.0 + 1.0 / 32.0 - 0.5, (i / 16) as f64 / 16.0 + 1.0 / 32.0 - 0.5);
        let inside = |&i: &usize| {
            let (u, v) = at(i);
            self.contains(f64::from(x_mm) + u * side_mm, f64::from(y_mm) + v * side_mm)
        };
        (0..256).filter(inside).count() as u16
    }
}

/// Ellipses with a shorter radius from `shortest_mm` to 30 mm, a longer one of up to 58 mm, an aspect ratio from
/// `min_aspect_ratio` to 3, and the first radius clearly less than 45 degrees from x.
fn truth(shortest_mm: f64, min_aspect_ratio: f64) -> impl Strategy<Value = Truth> {
    let centre = (-4.0..4.0f64, -4.0..4.0f64);
    (centre, shortest_mm..30.0, min_aspect_ratio..3.0, any::<bool>(), -43.0..43.0f64).prop_map(
        |((x_mm, y_mm), short_mm, aspect_ratio, along_x, angle_deg)| {
            // The ellipse must lie within the grid of cells, which extends to 64 mm.
            let long_mm = (short_mm * aspect_ratio).min(58.0);
            let (r_a_mm, r_b_mm) = if along_x { (long_mm, short_mm) } else { (short_mm, long_mm) };
            Truth { x_mm, y_mm, r_a_mm, r_b_mm, angle_deg }
        },
    )
}

/// Centres of `count` by `count` square cells of this side, in a grid around the origin.
fn grid(count: i32, side_mm: f32) -> impl Iterator<Item = (f32, f32)> + Clone {
    let at = move |i: i32| (i as f32 - (count - 1) as f32 / 2.0) * side_mm;
    (0..count).flat_map(move |iy| (0..count).map(move |ix| (at(ix), at(iy))))
}

/// A cell of the heel.
fn heel_cell(x_mm: f32, y_mm: f32, area_mm2: f32) -> Cell {
    cell(Region::Heel, x_mm, y_mm, area_mm2).cell()
}

/// Area moments about the origin of cells that are wholly in contact.
fn whole_cells(cells: &[(f32, f32)], area_mm2: f32) -> AreaMoments {
    let cells: Vec<_> = cells.iter().map(|&(x, y)| (heel_cell(x, y, area_mm2), WHOLE)).collect();
    moments(&cells, 0.0, 0.0)
}

/// Checks that an ellipse agrees with the known one. The tolerance of the radii is relative; the area has twice that tolerance.
fn assert_recovers(
    got: &Ellipse<f32>,
    truth: &Truth,
    position_tolerance_mm: f64,
    radius_tolerance: f64,
    angle_tolerance_deg: f64,
) {
    let near = |got: f32, want: f64, tolerance: f64| (f64::from(got) - want).abs() <= tolerance;
    assert!(near(got.x_mm, truth.x_mm, position_tolerance_mm), "x: {got:?}, {truth:?}");
    assert!(near(got.y_mm, truth.y_mm, position_tolerance_mm), "y: {got:?}, {truth:?}");
    assert!(near(got.r_a_mm, truth.r_a_mm, radius_tolerance * truth.r_a_mm), "r_a: {got:?}, {truth:?}");
    assert!(near(got.r_b_mm, truth.r_b_mm, radius_tolerance * truth.r_b_mm), "r_b: {got:?}, {truth:?}");
    assert!(near(got.angle_deg(), truth.angle_deg, angle_tolerance_deg), "angle {}: {truth:?}", got.angle_deg());
    let area_mm2 = std::f64::consts::PI * truth.r_a_mm * truth.r_b_mm;
    assert!(near(got.area_mm2(), area_mm2, 2.0 * radius_tolerance * area_mm2), "area {}: {truth:?}", got.area_mm2());
}

proptest! {
    #![proptest_config(config())]

    /// Each cell of 2 mm counts by its covered share. The moments distribute the covered part of an edge cell over the whole
    /// cell, which makes the radii up to 2.5 % too large here. It also changes the covariance of x and y, by up to 0.2 mm2. This
    /// turns the axes of nearly round ellipses by more than half a degree.
    #[test]
    fn covered_shares_recover_the_ellipse(truth in truth(8.0, 1.2)) {
        let share = |(x, y): (f32, f32)| (heel_cell(x, y, 4.0), truth.share(x, y, 2.0));
        let cells: Vec<_> = grid(64, 2.0).map(share).collect();
        let got = Ellipse::from_moments(&moments(&cells, 0.0, 0.0)).expect("there is contact");
        // The difference of the variances along both axes is a quarter of that of the squared radii.
        let difference_mm2 = (truth.r_a_mm.powi(2) - truth.r_b_mm.powi(2)).abs() / 4.0;
        let turned_deg = (0.2 / difference_mm2).to_degrees();
        assert_recovers(&got, &truth, 0.05, 0.025, turned_deg.max(0.5));
    }

    /// Each cell of 2 mm counts whole if its centre is covered. The codes of the cells pass through the whole pipeline.
    #[test]
    fn counted_cells_recover_the_ellipse_in_foot_coordinates(
        truth in truth(12.0, 1.4),
        dx_mm in 0i16..80,
        dy_mm in 0i16..250,
    ) {
        let (dx_mm, dy_mm) = (f32::from(dx_mm), f32::from(dy_mm));
        let cells = grid(64, 2.0).map(|(x, y)| cell(Region::Hallux, x + dx_mm, y + dy_mm, 4.0));
        let mut insole = Box::new(Insole::<f32, 4096>::new());
        insole.set_up(SETUP, cells).expect("the set-up is accepted");
        let loaded = code_of(&LAW, 100.0);
        let code = |(x, y): (f32, f32)| if truth.contains(f64::from(x), f64::from(y)) { loaded } else { 0 };
        insole.frame(0, &grid(64, 2.0).map(code).collect::<Vec<_>>());
        let moved = Truth { x_mm: truth.x_mm + f64::from(dx_mm), y_mm: truth.y_mm + f64::from(dy_mm), ..truth };
        assert_recovers(&insole.ellipse(Region::Hallux as usize).expect("there is contact"), &moved, 0.6, 0.05, 4.0);
        let other_regions = (0..8).filter(|&r| r != Region::Hallux as usize);
        prop_assert!(other_regions.into_iter().all(|r| insole.ellipse(r).is_none()));
    }

    /// Mean and variances of the covered area for any cells with any shares, compared with floating-point sums.
    #[test]
    fn moments_are_those_of_the_covered_squares(
        // Positions in 1/64 mm and areas in 1/16 mm2, which the fixed-point numbers represent exactly.
        cells in prop::collection::vec((-3200i16..3200, -3200i16..3200, 1u16..1600, 0u16..=WHOLE), 1..256),
    ) {
        let place = |&(x, y, area, share): &(i16, i16, u16, u16)| {
            (heel_cell(f32::from(x) / 64.0, f32::from(y) / 64.0, f32::from(area) / 16.0), share)
        };
        let cells: Vec<_> = cells.iter().map(place).collect();
        let got = moments(&cells, 0.0, 0.0);

        let weigh = |(c, share): &(Cell, u16)| f64::from(c.area_mm2) * f64::from(*share) / f64::from(WHOLE);
        let sum = |value: &dyn Fn(&Cell) -> f64| cells.iter().map(|c| weigh(c) * value(&c.0)).sum::<f64>();
        let area_mm2 = sum(&|_| 1.0);
        prop_assert_eq!(got.area().area_mm2::<f64>(), area_mm2);
        let Some(second) = got.second_moments::<f64>() else {
            prop_assert_eq!(area_mm2, 0.0);
            return Ok(());
        };
        let SecondMoments { x_mm, y_mm, variance_x_mm2: xx, variance_y_mm2: yy, covariance_mm2: xy } = second;
        let mean = |value: &dyn Fn(&Cell) -> f64| sum(value) / area_mm2;
        let (mean_x, mean_y) = (mean(&|c| f64::from(c.x_mm)), mean(&|c| f64::from(c.y_mm)));
        let dx = |c: &Cell| f64::from(c.x_mm) - mean_x;
        let dy = |c: &Cell| f64::from(c.y_mm) - mean_y;
        // A square of the area A has the variance A / 12 along any axis. The fixed-point variance is truncated to 1/4096 mm2.
        let expected = [
            (x_mm, mean_x, 1e-9),
            (y_mm, mean_y, 1e-9),
            (xx, mean(&|c| dx(c).powi(2) + f64::from(c.area_mm2) / 12.0), 1.0 / 4096.0),
            (yy, mean(&|c| dy(c).powi(2) + f64::from(c.area_mm2) / 12.0), 1.0 / 4096.0),
            (xy, mean(&|c| dx(c) * dy(c)), 1e-9),
        ];
        for (got, want, tolerance) in expected {
            prop_assert!((got - want).abs() <= tolerance + 1e-9, "{} is not {}", got, want);
        }
    }

    #[test]
    fn the_reference_point_does_not_change_the_ellipse(
        truth in truth(12.0, 1.4),
        x_64 in -3200i16..3200,
        y_64 in -3200i16..3200,
    ) {
        let inside = grid(32, 4.0).filter(|&(x, y)| truth.contains(f64::from(x), f64::from(y)));
        let cells: Vec<_> = inside.map(|(x, y)| (heel_cell(x, y, 16.0), WHOLE)).collect();
        let (x_mm, y_mm) = (f32::from(x_64) / 64.0, f32::from(y_64) / 64.0);
        let here = Ellipse::<f64>::from_moments(&moments(&cells, 0.0, 0.0)).expect("there is contact");
        let there = Ellipse::<f64>::from_moments(&moments(&cells, x_mm, y_mm)).expect("there is contact");
        let back = there.moved(f64::from(x_mm), f64::from(y_mm));
        for (a, b) in [
            (here.x_mm, back.x_mm),
            (here.y_mm, back.y_mm),
            (here.r_a_mm, back.r_a_mm),
            (here.r_b_mm, back.r_b_mm),
            (f64::from(here.angle_deg()), f64::from(back.angle_deg())),
        ] {
            prop_assert!((a - b).abs() < 1e-4, "{:?} and {:?}", here, back);
        }
    }

    /// Compact and scattered contacts of cells with a side of 1 to 9 mm, in the device's precision.
    #[test]
    fn any_contact_has_a_valid_ellipse(
        cells in prop::collection::vec((0i8..16, 0i8..16), 1..40),
        side_mm in 1u8..10,
        x_mm in -40.0..40.0f32,
        y_mm in -40.0..40.0f32,
    ) {
        let side_mm = f32::from(side_mm);
        let place = |&(x, y): &(i8, i8)| (x_mm + f32::from(x) * side_mm, y_mm + f32::from(y) * side_mm);
        let places: Vec<_> = cells.iter().map(place).collect();
        assert_valid(&Ellipse::from_moments(&whole_cells(&places, side_mm * side_mm)).expect("there is contact"));
    }

    /// Single cells with areas down to the smallest one and distances up to the largest one that a set-up accepts.
    #[test]
    fn a_far_and_small_cell_has_a_valid_ellipse(
        x_mm in -MAX_DISTANCE_MM..MAX_DISTANCE_MM,
        y_mm in -MAX_DISTANCE_MM..MAX_DISTANCE_MM,
        area_16 in 1u16..20,
    ) {
        let far = whole_cells(&[(x_mm, y_mm)], f32::from(area_16) / 16.0);
        assert_valid(&Ellipse::from_moments(&far).expect("there is contact"));
    }
}

/// Checks that an ellipse has finite numbers, positive radii, and an angle of at most 45 degrees.
fn assert_valid(e: &Ellipse<f32>) {
    assert!([e.x_mm, e.y_mm].iter().all(|v| v.is_finite()), "{e:?}");
    assert!([e.r_a_mm, e.r_b_mm].iter().all(|v| v.is_finite() && *v > 0.0), "{e:?}");
    // The approximation of the arc tangent has an error of up to 0.16 degrees; the angle has half of that error.
    assert!(e.angle_deg().abs() <= 45.1, "{} degrees: {e:?}", e.angle_deg());
}

#[test]
fn no_contact_has_no_ellipse() {
    assert_eq!(Ellipse::<f32>::from_moments(&AreaMoments::NONE), None);
    assert_eq!(Ellipse::<f32>::from_moments(&moments(&[(heel_cell(1.0, 2.0, 25.0), 0)], 0.0, 0.0)), None);
}

#[test]
fn the_ellipse_of_one_cell_is_a_circle_with_the_moments_of_the_cell() {
    for (x_mm, y_mm) in [(0.0, 0.0), (-31.0, 12.5), (60.0, 110.0)] {
        let e = Ellipse::<f32>::from_moments(&whole_cells(&[(x_mm, y_mm)], 25.0)).expect("there is contact");
        assert_valid(&e);
        let radius_mm = 2.0 * (25.0f32 / 12.0).sqrt();
        assert!((e.x_mm - x_mm).abs() < 1e-3 && (e.y_mm - y_mm).abs() < 1e-3, "{e:?}");
        assert!((e.r_a_mm - radius_mm).abs() < 2e-3 && (e.r_b_mm - radius_mm).abs() < 2e-3, "{e:?}");
    }
}

#[test]
fn a_line_of_cells_has_its_longer_radius_along_the_line() {
    let line = |i: i32| i as f32 * 5.0 - 20.0;
    // Nine cells at a distance of 5 mm have the variance 25 (81 - 1) / 12, plus the variance of a cell.
    let long_mm = 2.0 * (25.0f32 * 80.0 / 12.0 + 25.0 / 12.0).sqrt();
    let short_mm = 2.0 * (25.0f32 / 12.0).sqrt();
    let along_x = whole_cells(&(0..9).map(|i| (line(i), 0.0)).collect::<Vec<_>>(), 25.0);
    let along_y = whole_cells(&(0..9).map(|i| (0.0, line(i))).collect::<Vec<_>>(), 25.0);
    for (moments, r_a_mm, r_b_mm) in [(along_x, long_mm, short_mm), (along_y, short_mm, long_mm)] {
        let e = Ellipse::<f32>::from_moments(&moments).expect("there is contact");
        assert_valid(&e);
        assert!((e.r_a_mm - r_a_mm).abs() < 1e-2 && (e.r_b_mm - r_b_mm).abs() < 1e-2, "{e:?}");
        assert!(e.angle_deg().abs() < 0.2, "{}", e.angle_deg());
    }
}

#[test]
fn the_ellipse_of_diagonal_cells_lies_at_45_degrees() {
    for (sign, angle_deg) in [(1.0, 45.0), (-1.0, -45.0)] {
        let e = Ellipse::<f32>::from_moments(&whole_cells(&[(0.0, 0.0), (5.0, sign * 5.0)], 25.0))
            .expect("there is contact");
        assert_valid(&e);
        assert!((e.angle_deg() - angle_deg).abs() < 0.2, "{}", e.angle_deg());
        // The centres are 5 sqrt(2) mm apart: their variance along the diagonal is 12.5 mm2, to which the variance of a cell is
        // added. At exactly 45 degrees r_a is the longer radius.
        let long_mm = 2.0 * (12.5f32 + 25.0 / 12.0).sqrt();
        assert!((e.r_a_mm - long_mm).abs() < 1e-2, "{e:?}");
        assert!((e.r_b_mm - 2.0 * (25.0f32 / 12.0).sqrt()).abs() < 1e-2, "{e:?}");
    }
}

#[test]
fn the_ellipse_of_a_square_block_is_a_circle_with_a_valid_angle() {
    // The block is not at the reference point, so that rounding decides which of the two variances is larger.
    for i in 0..400 {
        let (x_mm, y_mm) = (i as f32 * 0.37 - 70.0, 60.0 - i as f32 * 0.29);
        let block = [(0.0, 0.0), (5.0, 0.0), (0.0, 5.0), (5.0, 5.0)].map(|(dx, dy)| (x_mm + dx, y_mm + dy));
        let e = Ellipse::<f32>::from_moments(&whole_cells(&block, 25.0)).expect("there is contact");
        assert_valid(&e);
        // The radii differ only because the positions are rounded to 1/64 mm.
        assert!((e.r_a_mm / e.r_b_mm - 1.0).abs() < 0.01, "{e:?}");
    }
}
