//! Messages are decoded to physical units, and the soles that the page draws contain the cells of their insoles.

use phone_wire::{LayoutCell, Sole, decode_to_json};
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{
    ContactEllipse, Ellipses, Live, LiveRegion, MAX_MESSAGE, Refusal, Step, StepFoot, StepRegion, ToHost, encode,
};
use plantar::{Region, Side};
use recording::synthetic::{self, SyntheticWalk};
use recording::{Recording, VirtualInsole, pedar};
use serde_json::Value;
use std::path::Path;

fn bytes(message: &ToHost) -> Vec<u8> {
    let mut buffer = [0; MAX_MESSAGE];
    encode(message, &mut buffer).expect("it fits").to_vec()
}

fn decoded(message: &ToHost) -> Value {
    serde_json::from_str(&decode_to_json(&bytes(message)).expect("a message")).expect("JSON")
}

#[test]
fn a_live_frame_is_decoded_to_physical_units() {
    let mut live = Live { sequence: 7, t_us: 1_250_000, saturated: 1, clamped: 2, ..Live::default() };
    live.regions[0] = LiveRegion { area_mm2: 1234, deformation_um: 4567, model_dn: 3210, measured_dn: 4321 };
    let json = decoded(&ToHost::Live(live));
    assert_eq!(json["kind"], "live");
    assert_eq!(json["sequence"], 7);
    assert_eq!(json["t_s"], 1.25);
    let heel = &json["regions"][0];
    assert_eq!(heel["area_mm2"], 1234);
    assert_eq!(heel["deformation_mm"], 4.567);
    assert_eq!(heel["model_n"], 321.0);
    assert_eq!(heel["measured_n"], 432.1);
    assert_eq!(
        (&heel["saturated"], &heel["clamped"], &json["regions"][1]["clamped"]),
        (&true.into(), &false.into(), &true.into())
    );
}

#[test]
fn ellipses_are_decoded_to_physical_units_and_are_null_without_contact() {
    let heel = ContactEllipse { x_dmm: 355, y_dmm: 301, r_a_cmm: 2_512, r_b_cmm: 2_750, angle_ddeg: -105 };
    let mut regions = [ContactEllipse::default(); 8];
    regions[0] = heel;
    let json = decoded(&ToHost::Ellipses(Ellipses { sequence: 3, t_us: 2_500_000, regions }));
    assert_eq!((&json["kind"], &json["t_s"]), (&"ellipses".into(), &2.5.into()));
    let expected =
        serde_json::json!({ "x_mm": 35.5, "y_mm": 30.1, "r_a_mm": 25.12, "r_b_mm": 27.5, "angle_deg": -10.5 });
    assert_eq!(json["regions"][0], expected);
    assert_eq!(json["regions"].as_array().map(|regions| regions[1..].iter().all(Value::is_null)), Some(true));
}

#[test]
fn a_time_message_is_decoded_unchanged() {
    let json = decoded(&ToHost::Time { host_us: 5, device_us: 7 });
    assert_eq!(json, serde_json::json!({ "kind": "time", "host_us": 5, "device_us": 7 }));
}

#[test]
fn the_refusal_of_a_change_names_the_option_of_the_server() {
    let reason = |refusal| decoded(&ToHost::Refused(refusal))["reason"].clone();
    let text = reason(Refusal::NotUnderstood).to_string();
    assert!(text.contains("--accept-parameters") && text.contains("firmware"), "{text}");
    assert_eq!(reason(Refusal::Busy), Refusal::Busy.to_string());
}

#[test]
fn the_key_of_a_step_depends_on_its_content_and_not_on_restarts_of_the_insole() {
    let step = Step {
        step: 3,
        side: Side::Left,
        start_us: 5,
        duration_us: 600_000,
        sample_us: 10_000,
        bridged_frames: 0,
        saturated: 0,
        clamped: 0,
        contact_rule: ContactRule::COUNTED,
        regions: [StepRegion::default(); 8],
        boots_since: 0,
        start_unix_us: Some(9),
        refit: 0,
        foot: StepFoot::default(),
    };
    let key = |step: Step| decoded(&ToHost::Step(step))["key"].clone();
    assert_eq!(key(step), key(Step { boots_since: 2, ..step }));
    assert_ne!(key(step), key(Step { start_us: 6, ..step }));
    assert_ne!(key(step), key(Step { start_unix_us: None, ..step }));
}

#[test]
fn bytes_that_are_not_a_message_are_not_decoded() {
    assert_eq!(decode_to_json(&[]), None);
    assert_eq!(decode_to_json(&[0xff; 40]), None);
    let mut long = bytes(&ToHost::Refused(Refusal::NotUnderstood));
    long.push(0);
    assert_eq!(decode_to_json(&long), None);
}

#[test]
fn cells_of_the_computed_insole_lie_in_the_regions_of_the_generic_sole() {
    let Sole { regions, outline_mm, .. } = Sole::generic();
    let cells = synthetic::insole(240).cells;
    let outside = cells.iter().filter(|cell| {
        let centre_mm = [cell.x_mm as f32, cell.y_mm as f32];
        !inside(&regions[cell.region as usize].outline_mm, centre_mm) || !inside(&outline_mm, centre_mm)
    });
    // The centres of cells on a boundary may be on either side of it, so a few of the 240 cells may be outside.
    assert!(outside.count() <= 8);
    for (region, shape) in Region::ALL.iter().zip(&regions) {
        assert!(inside(&shape.outline_mm, shape.centre_mm), "{}: {:?}", region.name(), shape.centre_mm);
    }
}

/// Asserts that the sole of an insole contains the squares of all cells, and the centres of the contact ellipses in each frame
/// of the recording, and that the centre of each cell is within the outline of its region. Returns the number of ellipses, and
/// the number of those that extend beyond the sole.
fn assert_sole_fits(recording: &Recording) -> (u32, u32) {
    let virtual_insole = VirtualInsole::new(recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let layout: Vec<_> = virtual_insole.cells.iter().map(LayoutCell::from).collect();
    let Sole { from_mm, to_mm, outline_mm, regions } = Sole::of(&layout).expect("the cells can be drawn");
    for [x_mm, y_mm] in &outline_mm {
        assert!((from_mm[0]..=to_mm[0]).contains(x_mm) && (from_mm[1]..=to_mm[1]).contains(y_mm));
    }
    for cell in &layout {
        let half_mm = cell.area_mm2.sqrt() / 2.0;
        for (dx, dy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let corner = [cell.x_mm + dx * half_mm, cell.y_mm + dy * half_mm];
            assert!(inside(&outline_mm, corner), "the corner {corner:?} of {cell:?}");
        }
        assert!(inside(&regions[cell.region].outline_mm, [cell.x_mm, cell.y_mm]), "{cell:?}");
    }
    let mut insole = Box::new(Insole::<f64, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the insole is valid");
    let (mut codes, mut ellipses, mut beyond) = (vec![0; layout.len()], 0, 0);
    for frame in 0..virtual_insole.frames(recording) {
        virtual_insole.codes_of(recording, frame, &mut codes);
        insole.frame(frame as u32, &codes);
        for ellipse in (0..Region::ALL.len()).filter_map(|region| insole.ellipse(region)) {
            ellipses += 1;
            let (sin, cos) = f64::from(ellipse.angle_deg()).to_radians().sin_cos();
            let is_inside = |a: f64, b: f64| {
                let (a, b) = (a * ellipse.r_a_mm, b * ellipse.r_b_mm);
                let point = [ellipse.x_mm + a * cos - b * sin, ellipse.y_mm + a * sin + b * cos];
                inside(&outline_mm, point.map(|mm| mm as f32))
            };
            assert!(is_inside(0.0, 0.0), "{ellipse:?} in frame {frame}");
            let around = |step: u32| f64::from(10 * step).to_radians().sin_cos();
            beyond += u32::from(!(0..36).map(around).all(|(b, a)| is_inside(a, b)));
        }
    }
    assert!(ellipses > 100, "{ellipses} ellipses");
    (ellipses, beyond)
}

#[test]
fn the_sole_of_an_insole_contains_its_cells_and_ellipses() {
    for count in [60, 240] {
        let recording =
            synthetic::walk(&SyntheticWalk { cells: count, steps: 2, ..SyntheticWalk::default() }).recording;
        let (_, beyond) = assert_sole_fits(&recording);
        assert_eq!(beyond, 0, "ellipses of {count} cells");
    }
}

mod unpublished {
    use super::*;

    #[test]
    #[ignore = "needs recordings of people that are not public: cargo xtask test"]
    fn the_sole_of_a_pedar_insole_contains_its_cells_and_the_centres_of_its_ellipses() {
        let folder = std::env::var("PLANTAR_RECORDINGS").expect("`cargo xtask test` sets it");
        let folder = Path::new(&folder).join("pedar");
        for side in [Side::Left, Side::Right] {
            let (asc, geometry) = (folder.join("pedar_example.asc"), folder.join("geometry.csv"));
            let recording = pedar::import(&asc, &geometry, side, &mut |_, _| {}).expect("the recording is valid");
            let (ellipses, beyond) = assert_sole_fits(&recording);
            // An ellipse has the second moments of its contact, so it is larger than a contact with a hole or with separate
            // parts.
            println!("{beyond} of {ellipses} ellipses extend beyond the sole");
        }
    }
}

#[test]
fn cells_that_cannot_be_drawn_have_no_sole() {
    let cell = LayoutCell { region: 0, x_mm: 10.0, y_mm: 20.0, area_mm2: 100.0 };
    assert!(Sole::of(&[cell]).is_some());
    assert!(Sole::of(&[]).is_none());
    for damaged in [
        LayoutCell { x_mm: f32::NAN, ..cell },
        LayoutCell { y_mm: 1e9, ..cell },
        LayoutCell { area_mm2: -1.0, ..cell },
        LayoutCell { area_mm2: f32::INFINITY, ..cell },
    ] {
        assert!(Sole::of(&[cell, damaged]).is_none(), "{damaged:?}");
    }
}

/// True if a point lies inside a polygon: a line from the point in the direction of x crosses the polygon an odd number of times.
fn inside(polygon: &[[f32; 2]], [x, y]: [f32; 2]) -> bool {
    let next = polygon.iter().cycle().skip(1);
    let crossed = polygon
        .iter()
        .zip(next)
        .filter(|(a, b)| (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
    crossed.count() % 2 == 1
}
