//! Messages are decoded to physical units, and the regions that the page draws contain the cells of the computed walk.

use phone_wire::{decode_to_json, outline_mm, region_shapes};
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::{Live, LiveRegion, MAX_MESSAGE, Refusal, Step, StepFoot, StepRegion, ToHost, encode};
use plantar::{Region, Side};
use recording::synthetic;
use serde_json::Value;

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
fn a_time_message_is_decoded_unchanged() {
    let json = decoded(&ToHost::Time { host_us: 5, device_us: 7 });
    assert_eq!(json, serde_json::json!({ "kind": "time", "host_us": 5, "device_us": 7 }));
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
fn cells_of_the_computed_walk_lie_in_the_drawn_regions() {
    let shapes = region_shapes();
    let cells = synthetic::insole(240).cells;
    let outside = cells.iter().filter(|cell| {
        let at = [cell.x_mm as f32, cell.y_mm as f32];
        !inside(&shapes[cell.region as usize].outline_mm, at) || !inside(&outline_mm(), at)
    });
    // Cells on a boundary may be on either side of it.
    assert!(outside.count() <= 8);
    for (region, shape) in Region::ALL.iter().zip(&shapes) {
        assert!(inside(&shape.outline_mm, shape.centre_mm), "{}: {:?}", region.name(), shape.centre_mm);
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
