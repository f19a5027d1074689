//! Set-ups, messages, and sensor laws evaluated in f64, for tests. A sensor law is a cell's code as a function of its pressure.

use plantar::faults::{Fault, FaultKind, Faults, Place};
use plantar::pipeline::alert::DailyLoad;
use plantar::pipeline::bout::BoutKind;
use plantar::pipeline::calibrate::{CellCalibration, Curve, FULL_CODE, SensorLaw};
use plantar::pipeline::contact::{ContactRule, WHOLE};
use plantar::pipeline::cumulative::{RegionTotal, Totals};
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::region::{AreaMoments, Cell, RegionCell};
use plantar::pipeline::setup::{Setup, SetupCell};
use plantar::pipeline::stance_rule::Rejected;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{
    self, Alert, Bout, BoutRegion, Contents, Decoder, Hello, Live, LiveRegion, MAX_FRAME, MAX_MESSAGE, Radio, Reset,
    Status, Step, StepFoot, StepRegion,
};
use plantar::{Region, Side};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::sync::LazyLock;

/// The sensor law of a resistive sensor.
pub const LAW: SensorLaw = SensorLaw { full_kpa: 1000.0, exponent: 0.8 };

/// A left insole with 100 frames per second and the contact rule [`ContactRule::COUNTED`].
pub const SETUP: Setup = Setup {
    side: Side::Left,
    layout_id: 7,
    period_us: 10_000,
    sensor: LAW,
    contact: ContactRule::COUNTED,
    stance: StanceRule::ADAPTIVE,
};

/// Tissue parameters with the same force law in every region. Its ellipsoid is larger than the contact of any region.
pub static TISSUE: LazyLock<Tissue> = LazyLock::new(|| {
    Tissue::new([ForceLaw { ab_m2: 2e-3, c_m: 0.012, stiffness_pa: 5e5, damping_pa_s: 5e3, n: 1.2, m: 0.8 }; 8])
});

/// A cell with the ideal calibration.
pub fn cell(region: Region, x_mm: f32, y_mm: f32, area_mm2: f32) -> SetupCell {
    SetupCell::new(Cell { region, x_mm, y_mm, area_mm2 }, CellCalibration::IDEAL, 0)
}

/// The table of a sensor law, which the firmware evaluates.
pub fn curve(law: &SensorLaw) -> Curve {
    let mut curve = Curve::new();
    curve.set(law);
    curve
}

/// The code of a pressure, computed in f64 from the sensor law without a table.
pub fn code_of(law: &SensorLaw, pressure_kpa: f64) -> u16 {
    (f64::from(FULL_CODE) * (pressure_kpa / f64::from(law.full_kpa)).powf(f64::from(law.exponent))).round() as u16
}

/// The pressure of a code, computed in f64 from the sensor law without a table.
pub fn pressure_of(law: &SensorLaw, code: u16) -> f64 {
    f64::from(law.full_kpa) * (f64::from(code) / f64::from(FULL_CODE)).powf(1.0 / f64::from(law.exponent))
}

/// Area moments about the point `(x_mm, y_mm)` of cells, each with its share in contact relative to [`WHOLE`].
pub fn moments(cells: &[(Cell, u16)], x_mm: f32, y_mm: f32) -> AreaMoments {
    let mut moments = AreaMoments::NONE;
    for (cell, share) in cells {
        moments.add(&RegionCell::<f32>::new(cell, 1.0, x_mm, y_mm), *share);
    }
    moments
}

/// Area moments of one cell of this area that is wholly in contact, about its centre.
pub fn area_moments(area_mm2: f32) -> AreaMoments {
    moments(&[(cell(Region::Heel, 0.0, 0.0, area_mm2).cell(), WHOLE)], 0.0, 0.0)
}

/// A hello in which every optional field is present.
pub fn hello() -> Hello {
    Hello {
        major: protocol::MAJOR,
        minor: protocol::MINOR,
        firmware: text("0.1.0"),
        board: text("test"),
        side: Side::Right,
        layout_id: 0x1234_5678,
        cells: 200,
        period_us: 10_000,
        tissue_id: 77,
        contact_rule: ContactRule::COUNTED,
        reset: Reset::Panic,
        fault: Some(text("at a line")),
    }
}

/// A load bout with this number.
pub fn bout(number: u32) -> Bout {
    let region =
        BoutRegion { measured_integral_cns: 123_456, pressure_integral_dkpas: 65_540, peak_pressure_dkpa: 801 };
    Bout {
        number,
        side: Side::Right,
        kind: BoutKind::Shuffling,
        start_us: 9_000_000,
        duration_us: 61_230_000,
        regions: [region; 8],
        boots_since: 0,
        start_unix_us: Some(1_700_000_000_000_000),
    }
}

/// An alert with this number and a different value in each field.
pub fn alert(number: u32) -> Alert {
    Alert {
        number,
        side: Side::Right,
        start_us: 901_000_000,
        sustained: 0b10_1001,
        dose: 1,
        window_s: 900,
        today: 3,
        boots_since: 0,
        start_unix_us: Some(1_700_000_000_000_000),
    }
}

/// The load of a day, with a value other than 0 in each field.
pub fn daily_load() -> DailyLoad {
    let region =
        |i: u32| RegionTotal { dose_dkpa_s: 70_000 + i, squared_kpa2_s: 9_000_000 + i, sustained_s: 1_200 + i };
    DailyLoad {
        day: 20_000,
        totals: Totals { loaded_s: 30_000, steps: 4_321, regions: std::array::from_fn(|i| region(i as u32)) },
        sustained: 0b11_0000,
        dose: 0b100,
        alerts: 3,
        snoozed_s: 1_100,
    }
}

/// A step with this number and different values in most fields.
pub fn step(step: u32) -> Step {
    let region = |i: u16| StepRegion {
        measured_peak_dn: 1000 + i,
        model_peak_dn: 1100 + i,
        measured_integral_dns: 1200 + i,
        model_integral_dns: 1300 + i,
        area_peak_mm2: 1400 + i,
        deformation_peak_um: 1500 + i,
        deformation_rate_peak_dmm_s: 1600 + i,
        contact_ms: 700 + i,
        time_to_peak_ms: 200 + i,
        ellipse_x_dmm: 300 + i as i16,
        ellipse_y_dmm: -400 - i as i16,
        ellipse_r_a_cmm: 2100 + i,
        ellipse_r_b_cmm: 2200 + i,
        ellipse_angle_ddeg: -450 + i as i16,
        model_error_bp: 1900 + i,
        masked_cells: i as u8,
        stiffness_change_percent: 7 - i as i8,
        peak_pressure_dkpa: 2500 + i,
        peak_pressure_ms: 150 + i,
        pressure_integral_dkpas: 800 + i,
        mean_pressure_dkpa: 1250 + i,
        loading_rate_n_s: 6100 + i,
        contact_start_ms: 20 + i,
        residual_n: 30 + i as u8,
        counted_peak_mm2: 2000 + i,
    };
    Step {
        step,
        side: Side::Left,
        start_us: 5_000_000_000,
        duration_us: 680_000,
        sample_us: 10_000,
        bridged_frames: 2,
        saturated: 0b1000_0001,
        clamped: 0b0000_0100,
        contact_rule: ContactRule { on_kpa: 10.0, off_kpa: 7.5, full_kpa: 50.0 },
        regions: core::array::from_fn(|i| region(i as u16)),
        boots_since: 0,
        start_unix_us: Some(1_790_000_000_000_000),
        refit: 0b0010_0000,
        foot: StepFoot {
            peak_dn: 8000,
            first_peak_dn: 7900,
            first_peak_ms: 160,
            valley_dn: 6100,
            valley_ms: 330,
            second_peak_dn: 7800,
            second_peak_ms: 510,
            integral_dns: 3900,
            gait_x_10_dmm: 351,
            gait_y_10_dmm: 402,
            gait_x_30_dmm: 403,
            gait_y_30_dmm: 804,
            gait_x_50_dmm: 455,
            gait_y_50_dmm: 1206,
            gait_x_70_dmm: 407,
            gait_y_70_dmm: 1808,
            gait_x_90_dmm: -309,
            gait_y_90_dmm: 2110,
            gait_length_dmm: 1811,
            gait_width_dmm: 112,
            gait_velocity_mm_s: 333,
            excursion_index_dpercent: -114,
            arch_index_permille: 215,
        },
    }
}

/// A live frame with this number and a different value in each field.
pub fn live(sequence: u32) -> Live {
    let region =
        |i: u16| LiveRegion { area_mm2: 1000 + i, deformation_um: 2000 + i, model_dn: 3000 + i, measured_dn: 4000 + i };
    Live {
        sequence,
        t_us: 5_000_010_000,
        saturated: 0b0100_0000,
        clamped: 0b0000_0010,
        masked: 0b0010_0000,
        centre_x_dmm: 421,
        centre_y_dmm: -1234,
        regions: core::array::from_fn(|i| region(i as u16)),
    }
}

/// A status with different values in most fields.
pub fn status() -> Status {
    Status {
        uptime_us: 6_000_000_000,
        frames: 600,
        frames_missed: 1,
        frames_overrun: 2,
        live_due: 300,
        live_sent: 299,
        steps: 12,
        records_dropped: 3,
        rejected: Rejected { short: 4, long: 5, broken: 6 },
        bad_frames: 7,
        frame_cycles: (40_000, 90_000),
        stack_bytes: 2048,
        faults: 8,
        rezeroed: 9,
        not_stored: 10,
        contents: Contents {
            start: 11,
            next_record: 12,
            newer_kinds: 13,
            newer_records: 14,
            erased: 15,
            contradictions: 16,
        },
        is_clock_set: true,
        update_key: 17,
        is_worn: true,
        frames_skipped: 18,
        scanning_ms: 19,
        processing_ms: 20,
        supply_mv: Some(3300),
        radio: Radio::Failed(21),
    }
}

/// Faults with different values in most fields.
pub fn faults() -> Faults {
    let list = [
        Fault { kind: FaultKind::Open, place: Place::Row(3), found_ms: 12_000 },
        Fault { kind: FaultKind::Drift, place: Place::Cell(300), found_ms: 13_000 },
        Fault { kind: FaultKind::Short, place: Place::Column(5), found_ms: 14_000 },
    ];
    Faults {
        found: 3,
        rezeroed: 8,
        masked_cells: [1, 2, 3, 4, 5, 6, 7, 8],
        with_former_baseline: [8, 7, 6, 5, 4, 3, 2, 1],
        list: list.into_iter().collect(),
    }
}

/// A message with the framing of a byte carrier.
pub fn framed<T: Serialize>(message: &T) -> Vec<u8> {
    let (mut bytes, mut out) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
    let len = protocol::frame(protocol::encode(message, &mut bytes).expect("the message fits"), &mut out);
    out[..len].to_vec()
}

/// All messages that a decoder finds in a stream of bytes.
pub fn messages<T: DeserializeOwned>(decoder: &mut Decoder, stream: &[u8]) -> Vec<T> {
    stream.iter().filter_map(|&byte| decoder.push(byte).and_then(protocol::decode)).collect()
}

/// A text as a message contains it, with at most `N` bytes.
pub fn text<const N: usize>(text: &str) -> heapless::String<N> {
    text.try_into().expect("the text fits")
}
