//! Measures the lengths of the longest messages, in which every field has the value with the longest encoding.

use anyhow::Result;
use bench::Figures;
use plantar::Side;
use plantar::pipeline::bout::BoutKind;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::{
    Bout, BoutRegion, Live, LiveRegion, MAX_FRAME, MAX_MESSAGE, Step, StepFoot, StepRegion, ToHost, encode, frame,
};

/// A hundred years, us, which is longer than an insole can run.
const CENTURY_US: u64 = 100 * 366 * 24 * 3600 * 1_000_000;

/// Measures the lengths of a live frame, a step record and a load bout.
pub fn measure(figures: &mut Figures) -> Result<()> {
    let region = LiveRegion { area_mm2: u16::MAX, deformation_um: u16::MAX, model_dn: u16::MAX, measured_dn: u16::MAX };
    let live = Live {
        sequence: u32::MAX,
        t_us: CENTURY_US,
        saturated: u8::MAX,
        clamped: u8::MAX,
        masked: u8::MAX,
        centre_x_dmm: i16::MAX,
        centre_y_dmm: i16::MAX,
        regions: [region; 8],
    };
    let step = Step {
        step: u32::MAX,
        side: Side::Right,
        start_us: CENTURY_US,
        duration_us: u32::MAX,
        sample_us: u32::MAX,
        bridged_frames: u16::MAX,
        saturated: u8::MAX,
        clamped: u8::MAX,
        contact_rule: ContactRule::COUNTED,
        // The fields of a region have a fixed length.
        regions: [StepRegion::default(); 8],
        boots_since: u32::MAX,
        start_unix_us: Some(2 * CENTURY_US),
        refit: u8::MAX,
        foot: StepFoot::default(),
    };
    let bout = Bout {
        number: u32::MAX,
        side: Side::Right,
        kind: BoutKind::Sitting,
        start_us: CENTURY_US,
        duration_us: u32::MAX,
        // The fields of a region have a fixed length.
        regions: [BoutRegion::default(); 8],
        boots_since: u32::MAX,
        start_unix_us: Some(2 * CENTURY_US),
    };
    for (key, message, meaning) in [
        ("live_frame_bytes", ToHost::Live(live), "longest live frame, bytes"),
        ("step_record_bytes", ToHost::Step(step), "longest step record, bytes"),
        ("bout_record_bytes", ToHost::Bout(bout), "longest load bout, bytes"),
    ] {
        let (mut buffer, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
        let message = encode(&message, &mut buffer)?;
        figures.add(key, message.len(), meaning);
        let on_uart = frame(message, &mut framed);
        figures.add(&format!("{key}.uart"), on_uart, "bytes on the serial port, with CRC, COBS and delimiter");
    }
    Ok(())
}
