//! The live values of a frame as a row of numbers. An absent value is `None`. `cop` is the centre of pressure, of the foot or
//! of a region; `total_force_n` is the sum of the measured forces of the regions. `docs/quantities.md` defines the other
//! quantities. It lists those of the ellipse and `masked_cells` under a region of a step; here they are those of the frame.

use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::{Real, Region};

/// Time, and the columns of the foot.
const FOOT_COLUMNS: [&str; 4] = ["t_s", "total_force_n", "cop_x_mm", "cop_y_mm"];

/// The columns of each region. In a table, their names have the prefix `<region>_`.
const REGION_COLUMNS: [&str; 14] = [
    "area_mm2",
    "measured_force_n",
    "deformation_mm",
    "model_force_n",
    "cop_x_mm",
    "cop_y_mm",
    "ellipse_x_mm",
    "ellipse_y_mm",
    "ellipse_r_a_mm",
    "ellipse_r_b_mm",
    "ellipse_angle_deg",
    "saturated",
    "clamped",
    "masked_cells",
];

/// The columns of the contact rule. Their values are the same in every row.
const RULE_COLUMNS: [&str; 3] = ["contact_on_kpa", "contact_off_kpa", "contact_full_kpa"];

/// The names of all columns, in the order of the values in a row.
pub fn column_names() -> Vec<String> {
    let regions =
        Region::ALL.iter().flat_map(|r| REGION_COLUMNS.iter().map(move |column| format!("{}_{column}", r.name())));
    let rule = RULE_COLUMNS.iter().map(|column| (*column).into());
    FOOT_COLUMNS.into_iter().map(String::from).chain(regions).chain(rule).collect()
}

/// Appends the values of the insole's last frame, at time `t_s`, to `row`, in the order of [`column_names`]. `rule` is the
/// contact rule of the insole.
pub fn push_row<R: Real, const N: usize>(
    row: &mut Vec<Option<f64>>,
    t_s: f64,
    insole: &Insole<R, N>,
    rule: ContactRule,
) {
    let loads = insole.loads();
    let total_n: f64 = loads.iter().map(|load| load.frame.force.force_n.to_f64()).sum();
    let cop = insole.foot_centre_mm().filter(|_| total_n > 0.0);
    row.extend([Some(t_s), Some(total_n), cop.map(|(x, _)| x.to_f64()), cop.map(|(_, y)| y.to_f64())]);
    for (i, load) in loads.iter().enumerate() {
        let cop = insole.centre_of_pressure_mm(i);
        let ellipse = insole.ellipse(i);
        row.extend([
            Some(load.frame.area.area_mm2::<f64>()),
            Some(load.frame.force.force_n.to_f64()),
            Some(load.tissue.deformation_m.to_f64() * 1e3),
            Some(load.tissue.model_n.to_f64()),
            cop.map(|(x, _)| x.to_f64()),
            cop.map(|(_, y)| y.to_f64()),
            ellipse.map(|e| e.x_mm.to_f64()),
            ellipse.map(|e| e.y_mm.to_f64()),
            ellipse.map(|e| e.r_a_mm.to_f64()),
            ellipse.map(|e| e.r_b_mm.to_f64()),
            ellipse.map(|e| f64::from(e.angle_deg())),
            Some(f64::from(u8::from(load.frame.saturated))),
            Some(f64::from(u8::from(load.tissue.clamped))),
            Some(f64::from(insole.faults().masked_cells[i])),
        ]);
    }
    let ContactRule { on_kpa, off_kpa, full_kpa } = rule;
    row.extend([on_kpa, off_kpa, full_kpa].map(|kpa| Some(f64::from(kpa))));
}
