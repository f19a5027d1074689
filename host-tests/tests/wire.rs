//! Messages and frames: every message arrives as it was sent, and damaged messages are refused.

use plantar::checksum::crc32;
use plantar::faults::{Fault, FaultKind, Faults, MAX_FAULTS, Place};
use plantar::insole::Insole;
use plantar::pipeline::alert::{AlertRules, DailyLoad};
use plantar::pipeline::baseline::ZeroResult;
use plantar::pipeline::bout::BoutKind;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::cumulative::{RegionTotal, Totals};
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::region::{ForceMoments, RegionFrame};
use plantar::pipeline::setup::Setup;
use plantar::pipeline::stance_rule::Rejected;
use plantar::pipeline::tissue::{AreaFilter, Identified, Tissue};
use plantar::protocol::update::{self, Chunk, Header, Offer, Progress, Request, Signature};
use plantar::protocol::{Alert, BLOCK_CELLS, Bout, BoutRegion, CalibrationBlock, Contents};
use plantar::protocol::{
    CellCoder, CellFrame, CellStream, ContactEllipse, Decoder, Ellipses, Hello, Identity, Live, LiveRegion, MAJOR,
    MAX_FRAME, MAX_LIVE, MAX_MESSAGE, MINOR, Radio, Refusal, Reset, Resolution, Serial, Settings, Status, Step,
    StepFoot, StepRegion, ToDevice, ToHost, decode, encode, frame,
};
use plantar::{Region, Side};
use proptest::prelude::*;
use std::io::Read;
use std::slice::from_ref;
use testkit::{TISSUE, alert, bout, cell, daily_load, faults, framed, hello, live, messages, status, step, text};

fn config() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::default() }
}

fn encoded<T: serde::Serialize>(message: &T) -> Vec<u8> {
    encode(message, &mut [0; MAX_MESSAGE]).expect("the message fits").to_vec()
}

fn side() -> impl Strategy<Value = Side> {
    prop_oneof![Just(Side::Left), Just(Side::Right)]
}

fn contact_rule() -> impl Strategy<Value = ContactRule> {
    let number = || any::<f32>().prop_filter("a NaN does not equal itself", |v| !v.is_nan());
    (number(), number(), number()).prop_map(|(on_kpa, off_kpa, full_kpa)| ContactRule { on_kpa, off_kpa, full_kpa })
}

fn any_hello() -> impl Strategy<Value = Hello> {
    let resets = [Reset::Power, Reset::Pin, Reset::Software, Reset::Watchdog, Reset::Panic, Reset::Unknown];
    let reset = prop::sample::select(resets.to_vec());
    let numbers = (any::<(u8, u8, u32, u16, u32, u32)>(), side(), contact_rule(), reset);
    let texts = ("[ -~]{0,16}", "[ -~]{0,16}", prop::option::of("[ -~]{0,96}"));
    (numbers, texts).prop_map(
        |(
            ((major, minor, layout_id, cells, period_us, tissue_id), side, contact_rule, reset),
            (firmware, board, fault),
        )| {
            Hello {
                major,
                minor,
                firmware: text(&firmware),
                board: text(&board),
                side,
                layout_id,
                cells,
                period_us,
                tissue_id,
                contact_rule,
                reset,
                fault: fault.map(|fault| text(&fault)),
            }
        },
    )
}

fn any_live() -> impl Strategy<Value = Live> {
    (any::<(u32, u64, u8, u8, u8, i16, i16)>(), prop::array::uniform8(any::<[u16; 4]>())).prop_map(
        |((sequence, t_us, saturated, clamped, masked, centre_x_dmm, centre_y_dmm), regions)| {
            let region = |[area_mm2, deformation_um, model_dn, measured_dn]: [u16; 4]| LiveRegion {
                area_mm2,
                deformation_um,
                model_dn,
                measured_dn,
            };
            let regions = regions.map(region);
            Live { sequence, t_us, saturated, clamped, masked, centre_x_dmm, centre_y_dmm, regions }
        },
    )
}

/// A region from its encoded bytes. All of its numbers have a fixed length, so any bytes of that length are a region.
fn step_region(bytes: &[u8]) -> StepRegion {
    decode(bytes).expect("any bytes are a region")
}

/// Length of an encoded [`StepRegion`].
fn step_region_bytes() -> usize {
    encoded(&StepRegion::default()).len()
}

fn any_step() -> impl Strategy<Value = Step> {
    let bytes = prop::collection::vec(any::<u8>(), step_region_bytes());
    let regions = prop::array::uniform8(bytes.prop_map(|bytes| step_region(&bytes)));
    let numbers = any::<((u32, u64, u32, u32, u16, u8, u8), (u32, Option<u64>, u8))>();
    (numbers, side(), contact_rule(), regions).prop_map(
        |(
            (
                (step, start_us, duration_us, sample_us, bridged_frames, saturated, clamped),
                (boots_since, start_unix_us, refit),
            ),
            side,
            contact_rule,
            regions,
        )| {
            Step {
                step,
                side,
                start_us,
                duration_us,
                sample_us,
                bridged_frames,
                saturated,
                clamped,
                contact_rule,
                regions,
                boots_since,
                start_unix_us,
                refit,
                foot: StepFoot { peak_dn: saturated.into(), gait_x_10_dmm: -1, ..StepFoot::default() },
            }
        },
    )
}

fn any_status() -> impl Strategy<Value = Status> {
    any::<(u64, [u32; 26])>().prop_map(|(uptime_us, v)| Status {
        uptime_us,
        frames: v[0],
        frames_missed: v[1],
        frames_overrun: v[2],
        live_due: v[3],
        live_sent: v[4],
        steps: v[5],
        records_dropped: v[6],
        rejected: Rejected { short: v[7], long: v[8], broken: v[9] },
        bad_frames: v[10],
        frame_cycles: (v[11], v[12]),
        stack_bytes: v[13],
        faults: v[14],
        rezeroed: v[15],
        not_stored: v[16],
        contents: Contents {
            start: v[17],
            next_record: v[18],
            newer_kinds: v[19],
            newer_records: v[20],
            erased: v[21],
            contradictions: v[22],
        },
        is_clock_set: v[0] % 2 == 1,
        update_key: v[1],
        is_worn: v[2] % 2 == 1,
        frames_skipped: v[23],
        scanning_ms: v[24],
        processing_ms: v[25],
        supply_mv: (v[3] % 2 == 1).then_some(v[4] as u16),
        radio: [Radio::Silent, Radio::Answers, Radio::NoFirmware, Radio::Failed(v[5] as u8)][v[6] as usize % 4],
    })
}

fn any_tissue() -> impl Strategy<Value = Tissue> {
    let number = any::<f32>().prop_filter("a NaN does not equal itself", |v| !v.is_nan());
    let law = prop::array::uniform6(number).prop_map(|[ab_m2, c_m, stiffness_pa, damping_pa_s, n, m]| ForceLaw {
        ab_m2,
        c_m,
        stiffness_pa,
        damping_pa_s,
        n,
        m,
    });
    (any::<u32>(), prop::array::uniform8(law)).prop_map(|(id, force_laws)| Tissue { id, force_laws })
}

const UPDATE_REFUSALS: [update::Refusal; 9] = [
    update::Refusal::Board,
    update::Refusal::Older,
    update::Refusal::Length,
    update::Refusal::OnTrial,
    update::Refusal::NotBegun,
    update::Refusal::Incomplete,
    update::Refusal::Header,
    update::Refusal::Signature,
    update::Refusal::Chip,
];

fn any_update() -> impl Strategy<Value = Request> {
    prop_oneof![
        (any::<u16>(), any::<Signature>()).prop_map(|(chunks, signature)| {
            Request::Begin(Offer { header: Header::new("board", "1.2.3"), chunks, signature })
        }),
        any::<(u16, Chunk)>().prop_map(|(number, chunk)| Request::Chunk { number, chunk }),
        Just(Request::Finish),
        Just(Request::Confirm),
    ]
}

fn any_refusal() -> impl Strategy<Value = Refusal> {
    let regions = Region::ALL.map(Refusal::Tissue);
    prop::sample::select(
        [
            &[
                Refusal::NotUnderstood,
                Refusal::TissueId,
                Refusal::NotStored,
                Refusal::Busy,
                Refusal::Serial,
                Refusal::Calibration,
                Refusal::CellRate { every: 2 },
                Refusal::NoLayout,
                Refusal::Settings,
                Refusal::ContactRule,
                Refusal::AlertRules,
                Refusal::EllipseRate { every: 4 },
                Refusal::NotLifted,
                Refusal::Clock,
                Refusal::OtherHost,
            ],
            &regions[..],
            &UPDATE_REFUSALS.map(Refusal::Update),
        ]
        .concat(),
    )
}

fn any_faults() -> impl Strategy<Value = Faults> {
    let place = prop_oneof![
        any::<u16>().prop_map(Place::Cell),
        any::<u8>().prop_map(Place::Row),
        any::<u8>().prop_map(Place::Column),
    ];
    let fault = (prop::sample::select(FaultKind::ALL.to_vec()), place, any::<u32>())
        .prop_map(|(kind, place, found_ms)| Fault { kind, place, found_ms });
    (any::<(u32, u32, [u8; 8], [u8; 8])>(), prop::collection::vec(fault, 0..=MAX_FAULTS)).prop_map(
        |((found, rezeroed, masked_cells, with_former_baseline), list)| Faults {
            found,
            rezeroed,
            masked_cells,
            with_former_baseline,
            list: list.into_iter().collect(),
        },
    )
}

fn to_host() -> impl Strategy<Value = ToHost> {
    prop_oneof![
        any_hello().prop_map(ToHost::Hello),
        any_live().prop_map(ToHost::Live),
        any_step().prop_map(ToHost::Step),
        any_status().prop_map(ToHost::Status),
        any_tissue().prop_map(ToHost::Tissue),
        any_refusal().prop_map(ToHost::Refused),
        any::<(u64, u64)>().prop_map(|(host_us, device_us)| ToHost::Time { host_us, device_us }),
        any_faults().prop_map(ToHost::Faults),
        (side(), serial(), any::<u32>()).prop_map(|(side, serial, calibration_id)| ToHost::Identity(Identity {
            side,
            serial,
            calibration_id
        })),
        any::<u8>().prop_map(|block| ToHost::CalibrationBlock { block }),
        any::<u16>().prop_map(|next| ToHost::Update(Progress::Next(next))),
        (any::<(u32, u32)>(), prop::collection::vec(any::<u16>(), 0..=240)).prop_map(|((scan, dropped), codes)| {
            ToHost::Cells(CellCoder::new(Resolution::Oversampled).pack(scan, dropped, &codes))
        }),
        any::<Option<u8>>()
            .prop_map(|every| { ToHost::CellStream(every.map(|every| CellStream { every, ..CELL_STREAM })) }),
        any::<u16>().prop_map(|number| ToHost::Setup(any_settings(number).apply_to(testkit::SETUP))),
        any::<(u16, f32)>().prop_map(|(first, x_mm)| {
            let cells = (0..16).map(|_| cell(Region::Toe2, x_mm, 20.0, 25.0)).collect();
            ToHost::SetupCells { first, cells }
        }),
        any::<Option<u16>>().prop_map(|number| ToHost::Settings(number.map(any_settings))),
        any::<bool>().prop_map(|is_known| ToHost::Identified(is_known.then_some(IDENTIFIED))),
        any::<(u32, u64, u32, u32, u16)>().prop_map(|(number, start_us, duration_us, integral, peak)| {
            let region = BoutRegion {
                measured_integral_cns: integral,
                pressure_integral_dkpas: !integral,
                peak_pressure_dkpa: peak,
            };
            ToHost::Bout(Bout { start_us, duration_us, regions: [region; 8], ..bout(number) })
        }),
        any::<(u32, u64, u8, u8)>().prop_map(|(number, start_us, sustained, dose)| {
            ToHost::Alert(Alert { start_us, sustained, dose, ..alert(number) })
        }),
        any::<u16>().prop_map(|pause_s| ToHost::AlertRules(AlertRules { pause_s, ..AlertRules::RECOMMENDED })),
        any::<(u32, u8)>().prop_map(|(day, alerts)| ToHost::DailyLoad(DailyLoad { day, alerts, ..daily_load() })),
        any::<(u16, [u8; 8], [u16; 8])>().prop_map(|(changed, with_former_baseline, residual_dn)| {
            ToHost::Zero(ZeroResult { changed, with_former_baseline, residual_dn })
        }),
        Just(ToHost::Update(Progress::Accepted)),
        Just(ToHost::Update(Progress::Confirmed)),
        any::<(u32, u64, [i16; 5])>().prop_map(|(sequence, t_us, [x_dmm, y_dmm, r_a_cmm, r_b_cmm, angle_ddeg])| {
            let ellipse = ContactEllipse { x_dmm, y_dmm, r_a_cmm, r_b_cmm, angle_ddeg };
            ToHost::Ellipses(Ellipses { sequence, t_us, regions: [ellipse; 8] })
        }),
    ]
}

fn to_device() -> impl Strategy<Value = ToDevice> {
    prop_oneof![
        any::<(u8, u8)>().prop_map(|(major, minor)| ToDevice::Connect { major, minor }),
        any::<bool>().prop_map(|live| ToDevice::Stream { live }),
        any::<u32>().prop_map(|step| ToDevice::Acknowledge { number: step }),
        Just(ToDevice::GetStatus),
        any_tissue().prop_map(ToDevice::SetTissue),
        Just(ToDevice::GetTissue),
        any::<u64>().prop_map(|host_us| ToDevice::GetTime { host_us }),
        any::<u64>().prop_map(|unix_us| ToDevice::SetClock { unix_us }),
        Just(ToDevice::GetFaults),
        Just(ToDevice::GetIdentity),
        (side(), serial()).prop_map(|(side, serial)| ToDevice::SetIdentity { side, serial }),
        (any::<u8>(), prop::array::uniform16((any::<u16>(), 0.1f32..10.0))).prop_map(|(block, cells)| {
            let cells = cells.map(|(offset, gain)| CellCalibration { offset, gain });
            ToDevice::SetCalibrationBlock { block, cells }
        }),
        any::<(u32, u16, u32)>().prop_map(|(layout_id, cells, id)| ToDevice::SetCalibration { layout_id, cells, id }),
        Just(ToDevice::Restart),
        any_update().prop_map(ToDevice::Update),
        (1u8.., any::<bool>()).prop_map(|(every, is_converter)| {
            let resolution = if is_converter { Resolution::Converter } else { Resolution::Oversampled };
            ToDevice::StreamCells(Some(CellStream { resolution, every }))
        }),
        Just(ToDevice::StreamCells(None)),
        Just(ToDevice::GetSetup),
        any::<u16>().prop_map(|first| ToDevice::GetSetupCells { first }),
        Just(ToDevice::GetSettings),
        any::<Option<u16>>().prop_map(|number| ToDevice::SetSettings(number.map(any_settings))),
        (any_tissue(), any::<u16>()).prop_map(|(tissue, number)| {
            let contact = any_settings(number).contact;
            ToDevice::SetIdentifiedTissue { tissue, identified: Identified { contact, ..IDENTIFIED } }
        }),
        Just(ToDevice::GetIdentified),
        Just(ToDevice::GetAlertRules),
        any::<u16>().prop_map(|pause_s| ToDevice::SetAlertRules(AlertRules { pause_s, ..AlertRules::OFF })),
        Just(ToDevice::GetDailyLoad),
        any::<u16>().prop_map(|snoozed_s| ToDevice::SnoozeAlerts { snoozed_s }),
        any::<u8>().prop_map(|every| ToDevice::StreamEllipses { every }),
        Just(ToDevice::Zero),
        Just(ToDevice::EraseWearer),
    ]
}

/// Settings whose contact rule and frame period depend on `number`. They need not be in range.
fn any_settings(number: u16) -> Settings {
    let full_kpa = f32::from(number);
    Settings { contact: ContactRule { full_kpa, ..ContactRule::COUNTED }, period_us: number.into(), ..SETTINGS }
}

fn serial() -> impl Strategy<Value = Serial> {
    "[!-~]{0,16}".prop_map(|text| Serial::new(&text).expect("the serial number is valid"))
}

/// Messages of most kinds to the host.
fn samples() -> Vec<ToHost> {
    vec![
        ToHost::Hello(hello()),
        ToHost::Live(live(7)),
        ToHost::Step(step(9)),
        ToHost::Status(status()),
        ToHost::Tissue(*TISSUE),
        ToHost::Refused(Refusal::Tissue(Region::Hallux)),
        ToHost::Time { host_us: 5, device_us: 6 },
        ToHost::Faults(faults()),
        ToHost::Identity(identity()),
        ToHost::CalibrationBlock { block: 3 },
        ToHost::Update(Progress::Next(300)),
        ToHost::Bout(bout(10)),
        ToHost::Alert(alert(11)),
        ToHost::Ellipses(ellipses()),
    ]
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn messages_arrive_unchanged(message in to_host(), command in to_device()) {
        let mut decoder = Decoder::new();
        prop_assert_eq!(messages::<ToHost>(&mut decoder, &framed(&message)), [message.clone()]);
        prop_assert_eq!(messages::<ToDevice>(&mut decoder, &framed(&command)), [command]);
        prop_assert_eq!(decoder.bad_frames, 0);
        // The same without framing, on a packet carrier.
        prop_assert_eq!(decode::<ToHost>(&encoded(&message)), Some(message));
        prop_assert_eq!(decode::<ToDevice>(&encoded(&command)), Some(command));
    }

    #[test]
    fn a_frame_contains_one_zero_at_its_end(message in to_host()) {
        let bytes = framed(&message);
        prop_assert_eq!(bytes.iter().position(|&b| b == 0), Some(bytes.len() - 1));
    }

    /// A packet of a packet carrier is exactly one message.
    #[test]
    fn packets_with_too_few_or_too_many_bytes_are_refused(message in to_host(), extra in any::<u8>(), cut in any::<prop::sample::Index>()) {
        let bytes = encoded(&message);
        prop_assert_eq!(decode::<ToHost>(&bytes[..cut.index(bytes.len())]), None);
        let longer = [bytes.as_slice(), &[extra]].concat();
        prop_assert_eq!(decode::<ToHost>(&longer), None);
    }

    #[test]
    fn any_bytes_survive_framing(message in prop::collection::vec(prop_oneof![Just(0u8), any::<u8>()], 0..=MAX_MESSAGE)) {
        let mut out = [0; MAX_FRAME];
        let len = frame(&message, &mut out);
        let mut decoder = Decoder::new();
        let (end, body) = out[..len].split_last().expect("a frame has an end");
        prop_assert!(body.iter().all(|&byte| decoder.push(byte).is_none()));
        prop_assert_eq!(decoder.push(*end), Some(message.as_slice()));
    }

    #[test]
    fn a_message_is_received_after_any_bytes_and_a_zero(
        streams in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..2000), 1..4),
        message in to_host(),
    ) {
        let mut decoder = Decoder::new();
        for stream in streams {
            // It is practically impossible that random bytes have a valid CRC-32.
            prop_assert_eq!(messages::<ToHost>(&mut decoder, &stream), []);
            decoder.push(0);
            let bad = decoder.bad_frames;
            prop_assert_eq!(messages::<ToHost>(&mut decoder, &framed(&message)), [message.clone()]);
            prop_assert_eq!(decoder.bad_frames, bad);
        }
    }

    #[test]
    fn garbage_damages_only_its_own_frame(
        all in prop::collection::vec(to_host(), 1..6),
        garbage in prop::collection::vec(prop::collection::vec(1u8.., 1..600), 6),
    ) {
        let mut stream = Vec::new();
        for (message, garbage) in all.iter().zip(&garbage) {
            stream.extend(garbage);
            stream.push(0);
            stream.extend(framed(message));
        }
        let mut decoder = Decoder::new();
        prop_assert_eq!(messages::<ToHost>(&mut decoder, &stream), all.clone());
        prop_assert_eq!(decoder.bad_frames as usize, all.len());
    }

    #[test]
    fn random_damage_never_produces_another_message(message in to_host(), hits in prop::collection::vec((any::<prop::sample::Index>(), 1u8..), 1..8)) {
        let mut bytes = framed(&message);
        for (position, flipped_bits) in hits {
            let index = position.index(bytes.len());
            bytes[index] ^= flipped_bits;
        }
        bytes.push(0);
        let got = messages::<ToHost>(&mut Decoder::new(), &bytes);
        prop_assert!(got.iter().all(|m| *m == message), "{:?}", got);
    }
}

#[test]
fn a_stream_may_be_split_at_any_byte() {
    let all = samples();
    let stream: Vec<u8> = all.iter().flat_map(framed).collect();
    for split in 0..=stream.len() {
        let mut decoder = Decoder::new();
        let mut got = messages::<ToHost>(&mut decoder, &stream[..split]);
        got.extend(messages::<ToHost>(&mut decoder, &stream[split..]));
        assert_eq!(got, all, "split at {split}");
    }
}

#[test]
fn starting_in_the_middle_of_a_stream_loses_one_frame_at_most() {
    let all = samples();
    let first_len = framed(&all[0]).len();
    let stream: Vec<u8> = all.iter().flat_map(framed).collect();
    for start in 1..first_len {
        let mut decoder = Decoder::new();
        assert_eq!(messages::<ToHost>(&mut decoder, &stream[start..]), all[1..], "from byte {start}");
        // From the last byte of the first frame on, only its final zero is left, which does not count as a bad frame.
        assert_eq!(decoder.bad_frames, u32::from(start < first_len - 1), "from byte {start}");
    }
}

#[test]
fn a_truncated_frame_is_counted_and_the_next_frame_is_received() {
    for message in samples() {
        let bytes = framed(&message);
        for len in 1..bytes.len() - 1 {
            let mut decoder = Decoder::new();
            let stream = [&bytes[..len], &[0], bytes.as_slice()].concat();
            assert_eq!(messages::<ToHost>(&mut decoder, &stream), from_ref(&message), "{len} bytes");
            assert_eq!(decoder.bad_frames, 1, "{len} bytes");

            // If the final zero of the frame is lost too, the next frame is lost with it, and no other.
            let mut decoder = Decoder::new();
            let stream = [&bytes[..len], bytes.as_slice(), bytes.as_slice()].concat();
            assert_eq!(messages::<ToHost>(&mut decoder, &stream), from_ref(&message), "{len} bytes");
            assert_eq!(decoder.bad_frames, 1, "{len} bytes");
        }
    }
}

#[test]
fn a_bad_frame_of_about_the_maximum_length_or_longer_is_counted_once() {
    let good = framed(&ToDevice::GetStatus);
    for len in [MAX_FRAME - 1, MAX_FRAME, MAX_FRAME + 1, MAX_FRAME + 2, 100_000] {
        let mut decoder = Decoder::new();
        let stream = [vec![0xAA; len].as_slice(), &[0], good.as_slice()].concat();
        assert_eq!(messages::<ToDevice>(&mut decoder, &stream), [ToDevice::GetStatus], "{len} bytes");
        assert_eq!(decoder.bad_frames, 1, "{len} bytes");
    }
}

#[test]
fn zeros_between_frames_are_not_counted_as_errors() {
    let good = framed(&ToDevice::GetStatus);
    let mut decoder = Decoder::new();
    let stream = [&[0; 50], good.as_slice(), &[0; 50], good.as_slice()].concat();
    assert_eq!(messages::<ToDevice>(&mut decoder, &stream), [ToDevice::GetStatus; 2]);
    assert_eq!(decoder.bad_frames, 0);
}

#[test]
fn a_message_that_is_too_long_for_a_frame_is_not_received() {
    let mut out = [0; MAX_FRAME];
    let len = frame(&[0x55; MAX_MESSAGE + 1], &mut out);
    assert_eq!(messages::<ToHost>(&mut Decoder::new(), &out[..len]), []);
}

#[test]
fn no_single_bit_error_produces_another_message() {
    for message in samples() {
        let bytes = framed(&message);
        for bit in 0..bytes.len() * 8 {
            let mut damaged = [bytes.as_slice(), bytes.as_slice(), bytes.as_slice()].concat();
            damaged[bytes.len() + bit / 8] ^= 1 << (bit % 8);
            let mut decoder = Decoder::new();
            let got = messages::<ToHost>(&mut decoder, &damaged);
            assert!(got.iter().all(|m| *m == message), "bit {bit}: {got:?}");
            // If the damaged bit is in the final zero, the third frame is lost too.
            let is_end = bit / 8 == bytes.len() - 1;
            assert_eq!(got.len(), if is_end { 1 } else { 2 }, "bit {bit}");
            assert!((1..=2).contains(&decoder.bad_frames), "bit {bit}: {}", decoder.bad_frames);
        }
    }
}

/// Any device can advertise the name of an insole, and hosts print the texts of its hello.
#[test]
fn texts_of_a_hello_do_not_control_a_terminal() {
    let sent =
        Hello { firmware: text("1\u{1b}[2J"), board: text("b\u{9b}\u{7}"), fault: Some(text("a\r\nb é")), ..hello() };
    let mut message = [0; MAX_MESSAGE];
    let decoded = decode::<ToHost>(encode(&ToHost::Hello(sent.clone()), &mut message).expect("it fits"));
    let expected = Hello { firmware: text("1?[2J"), board: text("b??"), fault: Some(text("a??b é")), ..sent };
    assert_eq!(decoded, Some(ToHost::Hello(expected)));
}

#[test]
fn longest_messages_fit_their_limits() {
    let max_text = "x".repeat(96);
    let longest_hello = Hello {
        major: u8::MAX,
        minor: u8::MAX,
        firmware: text(&max_text[..16]),
        board: text(&max_text[..16]),
        layout_id: u32::MAX,
        cells: u16::MAX,
        period_us: u32::MAX,
        tissue_id: u32::MAX,
        fault: Some(text(&max_text)),
        ..hello()
    };
    let region = LiveRegion { area_mm2: u16::MAX, deformation_um: u16::MAX, model_dn: u16::MAX, measured_dn: u16::MAX };
    let longest_live = ToHost::Live(Live {
        sequence: u32::MAX,
        t_us: u64::MAX,
        saturated: u8::MAX,
        clamped: u8::MAX,
        masked: u8::MAX,
        centre_x_dmm: i16::MAX,
        centre_y_dmm: i16::MAX,
        regions: [region; 8],
    });
    let longest_step = ToHost::Step(Step {
        step: u32::MAX,
        start_us: u64::MAX,
        duration_us: u32::MAX,
        sample_us: u32::MAX,
        bridged_frames: u16::MAX,
        saturated: u8::MAX,
        clamped: u8::MAX,
        regions: [step_region(&vec![0xff; step_region_bytes()]); 8],
        boots_since: u32::MAX,
        start_unix_us: Some(u64::MAX),
        refit: u8::MAX,
        ..step(0)
    });
    let region =
        BoutRegion { measured_integral_cns: u32::MAX, pressure_integral_dkpas: u32::MAX, peak_pressure_dkpa: u16::MAX };
    let longest_bout = ToHost::Bout(Bout {
        start_us: u64::MAX,
        duration_us: u32::MAX,
        regions: [region; 8],
        boots_since: u32::MAX,
        start_unix_us: Some(u64::MAX),
        ..bout(u32::MAX)
    });
    let longest_status = ToHost::Status(Status {
        uptime_us: u64::MAX,
        frames: u32::MAX,
        frames_missed: u32::MAX,
        frames_overrun: u32::MAX,
        live_due: u32::MAX,
        live_sent: u32::MAX,
        steps: u32::MAX,
        records_dropped: u32::MAX,
        rejected: Rejected { short: u32::MAX, long: u32::MAX, broken: u32::MAX },
        bad_frames: u32::MAX,
        frame_cycles: (u32::MAX, u32::MAX),
        stack_bytes: u32::MAX,
        faults: u32::MAX,
        rezeroed: u32::MAX,
        not_stored: u32::MAX,
        contents: Contents {
            start: u32::MAX,
            next_record: u32::MAX,
            newer_kinds: u32::MAX,
            newer_records: u32::MAX,
            erased: u32::MAX,
            contradictions: u32::MAX,
        },
        is_clock_set: true,
        update_key: u32::MAX,
        is_worn: true,
        frames_skipped: u32::MAX,
        scanning_ms: u32::MAX,
        processing_ms: u32::MAX,
        supply_mv: Some(u16::MAX),
        radio: Radio::Failed(u8::MAX),
    });
    let longest_fault = Fault { kind: FaultKind::Crosstalk, place: Place::Cell(u16::MAX), found_ms: u32::MAX };
    let longest_faults = ToHost::Faults(Faults {
        found: u32::MAX,
        rezeroed: u32::MAX,
        masked_cells: [u8::MAX; 8],
        with_former_baseline: [u8::MAX; 8],
        list: [longest_fault; MAX_FAULTS].into_iter().collect(),
    });
    assert!(encoded(&longest_live).len() <= MAX_LIVE);
    assert!(framed(&longest_live).len() <= 112, "{}", framed(&longest_live).len());
    assert!(encoded(&longest_bout).len() <= 200, "{}", encoded(&longest_bout).len());
    // A sector has room for eight entries of the log of up to 500 bytes, and an entry is at most as long as the framed message.
    assert!(framed(&longest_step).len() <= 490, "{}", framed(&longest_step).len());
    let longest_tissue = Tissue { id: u32::MAX, ..*TISSUE };
    let longest_chunk = Request::Chunk { number: u16::MAX, chunk: [[0xff; 32]; 8] };
    for message in [ToDevice::SetTissue(longest_tissue), ToDevice::Update(longest_chunk)] {
        let bytes = framed(&message).len();
        assert!(bytes <= 288, "{bytes} bytes do not fit the boards' receive buffers");
    }
    let longest_tissue = ToHost::Tissue(longest_tissue);
    let longest_daily_load = ToHost::DailyLoad(DailyLoad {
        day: u32::MAX,
        totals: Totals {
            loaded_s: u32::MAX,
            steps: u32::MAX,
            regions: [RegionTotal { dose_dkpa_s: u32::MAX, squared_kpa2_s: u32::MAX, sustained_s: u32::MAX }; 8],
        },
        snoozed_s: u16::MAX,
        ..daily_load()
    });
    for message in [
        longest_live,
        longest_daily_load,
        longest_step,
        longest_status,
        longest_faults,
        longest_tissue,
        ToHost::Hello(longest_hello),
    ] {
        assert!(encoded(&message).len() <= MAX_MESSAGE, "{}", encoded(&message).len());
        assert_eq!(messages::<ToHost>(&mut Decoder::new(), &framed(&message)), [message]);
    }
    // The longest message fits into the longest frame; otherwise, the function panics.
    frame(&[0xAA; MAX_MESSAGE], &mut [0; MAX_FRAME]);
}

/// Carriers such as Bluetooth select messages by their first byte.
#[test]
fn the_first_byte_identifies_the_message() {
    let first = |message: &ToHost| encoded(message)[0];
    let expected =
        [ToHost::LIVE, ToHost::STEP, ToHost::TISSUE, ToHost::REFUSED, ToHost::BOUT, ToHost::ALERT, ToHost::ELLIPSES];
    let samples = samples();
    assert_eq!([1, 2, 4, 5, 11, 12, 13].map(|i| first(&samples[i])), expected);
    assert_eq!(first(&ToHost::Cells(cell_frame())), ToHost::CELLS);
}

#[test]
fn the_checksum_is_crc_32_iso_hdlc() {
    // The check value that the definition of CRC-32/ISO-HDLC contains.
    assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// The numbers of the values of enumerations in messages. They are part of the bytes of this version, but
/// [`messages_have_the_bytes_of_this_version`] has an example of each message, and so only some of the values.
#[test]
fn enumerations_have_the_numbers_of_this_version() {
    fn assert_numbered<T: serde::Serialize>(values: &[T]) {
        let numbers: Vec<u8> = values.iter().map(|value| encoded(value)[0]).collect();
        assert!(numbers.iter().copied().eq(0..values.len() as u8), "{}: {numbers:?}", std::any::type_name::<T>());
    }
    assert_numbered(&[Side::Left, Side::Right]);
    assert_numbered(&[
        Region::Heel,
        Region::PosteriorMidfoot,
        Region::AnteriorMidfoot,
        Region::Metatarsals12,
        Region::Metatarsals35,
        Region::Hallux,
        Region::Toe2,
        Region::Toes35,
    ]);
    assert_numbered(&[Reset::Power, Reset::Pin, Reset::Software, Reset::Watchdog, Reset::Panic, Reset::Unknown]);
    assert_numbered(&[BoutKind::Unclassified, BoutKind::Standing, BoutKind::Shuffling, BoutKind::Sitting]);
    assert_numbered(&[
        FaultKind::Open,
        FaultKind::Short,
        FaultKind::Stuck,
        FaultKind::Saturated,
        FaultKind::Drift,
        FaultKind::Crosstalk,
    ]);
    assert_numbered(&[Place::Cell(0), Place::Row(0), Place::Column(0)]);
    assert_numbered(&[AreaFilter::Direct, AreaFilter::Live]);
    assert_numbered(&[Resolution::Converter, Resolution::Oversampled]);
    assert_numbered(&UPDATE_REFUSALS);
}

/// The bytes of all messages of version 3.0 on a byte carrier, on which hosts and insoles in use depend. The bytes of Hello and
/// Connect must never change. A change of another message requires a higher `protocol::MAJOR`, a new message a higher
/// `protocol::MINOR`.
#[test]
fn messages_have_the_bytes_of_this_version() {
    assert_eq!((MAJOR, MINOR), (3, 0), "add the bytes of the new version to this test");
    let golden = [
        ("hello", framed(&ToHost::Hello(Hello { major: 1, minor: 0, ..hello() })), HELLO),
        ("live", framed(&ToHost::Live(live(300))), LIVE),
        ("step", framed(&ToHost::Step(step(41))), STEP),
        ("load bout", framed(&ToHost::Bout(bout(42))), BOUT),
        ("status", framed(&ToHost::Status(status())), STATUS),
        ("connect", framed(&ToDevice::Connect { major: 1, minor: 0 }), CONNECT),
        ("stream", framed(&ToDevice::Stream { live: true }), STREAM),
        ("acknowledge", framed(&ToDevice::Acknowledge { number: 41 }), ACKNOWLEDGE),
        ("get status", framed(&ToDevice::GetStatus), GET_STATUS),
        ("tissue", framed(&ToHost::Tissue(*TISSUE)), TISSUE_IN_FORCE),
        ("refused: not understood", framed(&ToHost::Refused(Refusal::NotUnderstood)), NOT_UNDERSTOOD),
        ("refused: id", framed(&ToHost::Refused(Refusal::TissueId)), TISSUE_ID),
        ("refused: values", framed(&ToHost::Refused(Refusal::Tissue(Region::Hallux))), TISSUE_VALUES),
        ("set tissue", framed(&ToDevice::SetTissue(*TISSUE)), SET_TISSUE),
        ("get tissue", framed(&ToDevice::GetTissue), GET_TISSUE),
        ("time", framed(&ToHost::Time { host_us: 1_000, device_us: 300 }), TIME),
        ("get time", framed(&ToDevice::GetTime { host_us: 1_000 }), GET_TIME),
        ("refused: not stored", framed(&ToHost::Refused(Refusal::NotStored)), NOT_STORED),
        ("refused: busy", framed(&ToHost::Refused(Refusal::Busy)), BUSY),
        ("refused: serial", framed(&ToHost::Refused(Refusal::Serial)), SERIAL),
        ("refused: calibration", framed(&ToHost::Refused(Refusal::Calibration)), CALIBRATION),
        ("identity", framed(&ToHost::Identity(identity())), IDENTITY),
        ("calibration block", framed(&ToHost::CalibrationBlock { block: 3 }), BLOCK_STORED),
        ("get identity", framed(&ToDevice::GetIdentity), GET_IDENTITY),
        (
            "set identity",
            framed(&ToDevice::SetIdentity { side: identity().side, serial: identity().serial }),
            SET_IDENTITY,
        ),
        ("set calibration block", framed(&ToDevice::SetCalibrationBlock { block: 3, cells: BLOCK }), SET_BLOCK),
        (
            "set calibration",
            framed(&ToDevice::SetCalibration { layout_id: 7, cells: 240, id: 0x1234_5678 }),
            SET_CALIBRATION,
        ),
        ("restart", framed(&ToDevice::Restart), RESTART),
        ("update: begin", framed(&ToDevice::Update(Request::Begin(OFFER))), BEGIN),
        ("update: chunk", framed(&ToDevice::Update(Request::Chunk { number: 300, chunk: [[7; 32]; 8] })), CHUNK),
        ("update: finish", framed(&ToDevice::Update(Request::Finish)), FINISH),
        ("update: confirm", framed(&ToDevice::Update(Request::Confirm)), CONFIRM),
        ("update: confirmed", framed(&ToHost::Update(Progress::Confirmed)), CONFIRMED),
        ("update: next", framed(&ToHost::Update(Progress::Next(300))), NEXT),
        ("update: accepted", framed(&ToHost::Update(Progress::Accepted)), ACCEPTED),
        ("refused: update", framed(&ToHost::Refused(Refusal::Update(update::Refusal::Signature))), UPDATE_REFUSED),
        ("set clock", framed(&ToDevice::SetClock { unix_us: 1_700_000_000_000_000 }), SET_CLOCK),
        ("faults", framed(&ToHost::Faults(faults())), FAULTS_FOUND),
        ("get faults", framed(&ToDevice::GetFaults), GET_FAULTS),
        ("stream cells", framed(&ToDevice::StreamCells(Some(CELL_STREAM))), STREAM_CELLS),
        ("stream of cells", framed(&ToHost::CellStream(Some(CELL_STREAM))), STREAM_OF_CELLS),
        ("cells", framed(&ToHost::Cells(cell_frame())), CELLS),
        ("get setup", framed(&ToDevice::GetSetup), GET_SETUP),
        ("setup", framed(&ToHost::Setup(testkit::SETUP)), SETUP),
        ("get setup cells", framed(&ToDevice::GetSetupCells { first: 16 }), GET_SETUP_CELLS),
        ("setup cells", framed(&setup_cells()), SETUP_CELLS),
        ("refused: cell rate", framed(&ToHost::Refused(Refusal::CellRate { every: 2 })), CELL_RATE),
        ("refused: no layout", framed(&ToHost::Refused(Refusal::NoLayout)), NO_LAYOUT),
        ("get settings", framed(&ToDevice::GetSettings), GET_SETTINGS),
        ("set settings", framed(&ToDevice::SetSettings(Some(SETTINGS))), SET_SETTINGS),
        ("settings", framed(&ToHost::Settings(None)), NO_SETTINGS),
        ("get identified", framed(&ToDevice::GetIdentified), GET_IDENTIFIED),
        ("identified", framed(&ToHost::Identified(Some(IDENTIFIED))), IDENTIFIED_BYTES),
        ("set identified tissue", framed(&set_identified_tissue()), SET_IDENTIFIED),
        ("refused: settings", framed(&ToHost::Refused(Refusal::Settings)), SETTINGS_REFUSED),
        ("refused: contact rule", framed(&ToHost::Refused(Refusal::ContactRule)), RULE_REFUSED),
        ("alert", framed(&ToHost::Alert(alert(43))), ALERT),
        ("rules of alerts", framed(&ToHost::AlertRules(AlertRules::RECOMMENDED)), ALERT_RULES),
        ("load of the day", framed(&ToHost::DailyLoad(daily_load())), DAILY_LOAD),
        ("get rules of alerts", framed(&ToDevice::GetAlertRules), GET_ALERT_RULES),
        ("set rules of alerts", framed(&ToDevice::SetAlertRules(AlertRules::OFF)), SET_ALERT_RULES),
        ("get load of the day", framed(&ToDevice::GetDailyLoad), GET_DAILY_LOAD),
        ("snooze", framed(&ToDevice::SnoozeAlerts { snoozed_s: 600 }), SNOOZE),
        ("refused: rules of alerts", framed(&ToHost::Refused(Refusal::AlertRules)), ALERT_RULES_REFUSED),
        ("zero", framed(&ToDevice::Zero), ZERO),
        ("erase", framed(&ToDevice::EraseWearer), ERASE_WEARER),
        ("refused: clock", framed(&ToHost::Refused(Refusal::Clock)), CLOCK_REFUSED),
        ("result of zero", framed(&ToHost::Zero(ZERO_RESULT)), ZERO_RESULT_BYTES),
        ("refused: not lifted", framed(&ToHost::Refused(Refusal::NotLifted)), NOT_LIFTED),
        ("stream ellipses", framed(&ToDevice::StreamEllipses { every: 4 }), STREAM_ELLIPSES),
        ("ellipses", framed(&ToHost::Ellipses(ellipses())), ELLIPSES),
        ("refused: ellipse rate", framed(&ToHost::Refused(Refusal::EllipseRate { every: 4 })), ELLIPSE_RATE),
        ("refused: other host", framed(&ToHost::Refused(Refusal::OtherHost)), OTHER_HOST),
    ];
    for (name, bytes, expected) in golden {
        assert_eq!(hex(&bytes), expected, "{name}");
    }
}

const ZERO_RESULT: ZeroResult =
    ZeroResult { changed: 300, with_former_baseline: [1, 2, 3, 4, 5, 6, 7, 8], residual_dn: [45; 8] };

const CELL_STREAM: CellStream = CellStream { resolution: Resolution::Oversampled, every: 2 };

/// Unloaded cells, cells that change, and a cell at full scale.
fn cell_frame() -> CellFrame {
    let mut codes = [0; 24];
    codes[8..16].copy_from_slice(&[160, 320, 480, 640, 800, 960, 1120, 1280]);
    codes[23] = 65520;
    CellCoder::new(Resolution::Converter).pack(300, 2, &codes)
}

fn ellipses() -> Ellipses {
    let heel = ContactEllipse { x_dmm: 300, y_dmm: -5, r_a_cmm: 2_500, r_b_cmm: 2_750, angle_ddeg: -123 };
    let mut regions = [ContactEllipse::default(); 8];
    regions[0] = heel;
    Ellipses { sequence: 300, t_us: 3_000_000, regions }
}

const SETTINGS: Settings = Settings {
    contact: ContactRule::COVERED,
    stance: plantar::pipeline::stance_rule::StanceRule::ADAPTIVE,
    period_us: 5_000,
    scale: 0.9,
};

const IDENTIFIED: Identified = Identified {
    contact: ContactRule::COVERED,
    filter: AreaFilter::Live,
    side: Some(Side::Right),
    steps: 300,
    regions: 0xFE,
};

fn set_identified_tissue() -> ToDevice {
    ToDevice::SetIdentifiedTissue { tissue: *TISSUE, identified: Identified { side: None, ..IDENTIFIED } }
}

fn setup_cells() -> ToHost {
    ToHost::SetupCells { first: 16, cells: [cell(Region::Hallux, 10.0, 200.0, 25.0)].into_iter().collect() }
}

fn identity() -> Identity {
    Identity {
        side: Side::Right,
        serial: Serial::new("P-0001").expect("the serial number is valid"),
        calibration_id: 300,
    }
}

const OFFER: Offer = Offer { header: Header::new("board", "1.2.3"), chunks: 300, signature: [[1; 32], [2; 32]] };
const BLOCK: CalibrationBlock = [CellCalibration { offset: 300, gain: 1.5 }; BLOCK_CELLS];

const HELLO: &str =
    "0102011705302e312e30047465737401f8acd19101c801904e4d010320410103f0400101011104010961742061206c696e65f2c164b700";
const LIVE: &str = "5501ac0290b298d012400220a5012efb40e803d007b80ba00fe903d107b90ba10fea03d207ba0ba20feb03d307bb0ba30fec03d407bc0ba40fed03d507bd0ba50fee03d607be0ba60fef03d707bf0ba70f55fd928900";
const STEP: &str = "0302290e80e497d012c0c029904e028104010320410103f04001084842401fdc1ea022d4174a01781efe013c0f5f01920193012403c701b60497011007cbfe3e08130770064d018effd712e8034c04b00414057805dc054006bc02c80d2c0170fe340898083efe6c070507c40996082003e204d41714151ed007e9034d04b10415057905dd054106bd02c9122d016ffe350899083ffe6d070106c50997082103e304d51715151fd107ea034e04b20416057a05de054206be02ca122e016efe36089a0840fe6e070205c60998082203e404d617161520d207eb034f04b30417057b05df054306bf02cb122f016dfe37089b0841fe6f070304c70999082303e504d717171521d307ec035004b40418057c05e0054406c002cc1230016cfe38089c0842fe70070403c8099a082403e604d817181522d407ed035104b50419057d05e1054506c102cd1231016bfe39089d0843fe71070502c9099b082503e704d917191523d507ee035204b6041a057e05e2054606c202ce1232016afe3a089e0844fe72070601ca099c082603e804da171a1524d607ef035304b7041b057f05e3054706c302cf0e330169fe3b089f0845fe73070704cb099d082703e904db171b0425d7070f0180c097d1edff960320dfe1df4100";
const ZERO: &str = "061b6126675800";
const ZERO_RESULT_BYTES: &str = "1816ac0201020304050607082d2d2d2d2d2d2d2d395318b500";
const ERASE_WEARER: &str = "061cc2b303c600";
const CLOCK_REFUSED: &str = "07050f2bfb11ac00";
const CONFIRM: &str = "070e03cb6e534600";
const CONFIRMED: &str = "070a02599b385500";
const OTHER_HOST: &str = "070510def6192100";
const NOT_LIFTED: &str = "07050ebdcb16db00";
const ALERT: &str = "0e122b01c0d6d0ad0329018407030e018080f9c0c1c48203c9e48caa00";
const ALERT_RULES: &str = "0213010c48436666964084075f50ff01010104b009140573e5f8c800";
const DAILY_LOAD: &str = "5b14a09c01b0ea01e121f0a204c0a8a504b009f1a204c1a8a504b109f2a204c2a8a504b209f3a204c3a8a504b309f4a204c4a8a504b409f5a204c5a8a504b509f6a204c6a8a504b609f7a204c7a8a504b709300403cc08e755e47f00";
const GET_ALERT_RULES: &str = "0616dc5ad62600";
const SET_ALERT_RULES: &str = "0217010c48436666964084075f50ff01010103b009010526a1f7ba00";
const GET_DAILY_LOAD: &str = "0618db776ec100";
const SNOOZE: &str = "0819d804e3ca3aa200";
const ALERT_RULES_REFUSED: &str = "07050c91aa183500";
const BOUT: &str = "10112a0102c0a8a504b097991d40e2010204020106210340e2010204020106210340e2010204020106210340e2010204020106210340e2010204020106210340e2010204020106210340e2010204020106210340e201020402010321030e018080f9c0c1c482037b37f30a00";
const STATUS: &str =
    "350380f882ad16d8040102ac02ab020c0304050607c0b80290bf05801008090a0b0c0d0e0f1001110112131401e419031506b90ee800";
const CONNECT: &str = "0102010553e85ae600";
const STREAM_CELLS: &str = "090f01010210f5f08f00";
const STREAM_OF_CELLS: &str = "080b0101024762920100";
const CELLS: &str = "020c11ac0202e722168014283c5064788ca00f01010101010101010107ff0fbc39565800";
const GET_SETUP: &str = "0610e9ffb5cf00";
const SETUP: &str = "020d0407904e01077a44cdcc4c3f010320410103f0400101010101030c42010c8c425a32c413010da2ba8900";
const GET_SETUP_CELLS: &str = "0711108b21b70f00";
const SETUP_CELLS: &str = "050e10010501032041010348430103c841010103803f058b1fbc9c00";
const CELL_RATE: &str = "08050802ddf05ddf00";
const NO_LAYOUT: &str = "0705091e5e724500";
const GET_SETTINGS: &str = "0612c59ebb2100";
const SET_SETTINGS: &str = "031301010320410103f0400103164301030c4201128c425a32c4130188276666663f0bc5df8700";
const NO_SETTINGS: &str = "020f05300e41c600";
const GET_IDENTIFIED: &str = "0615660bdfbf00";
const IDENTIFIED_BYTES: &str = "031001010320410103f040010d1643010101ac02fe464fedf700";
const SET_IDENTIFIED: &str = "0f14c395a3cf0a6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f4480c409c459a99993fcdcc4c3f010320410103f040010416430108ac02fef7ed2e3a00";
const SETTINGS_REFUSED: &str = "07050aa40f7bdc00";
const RULE_REFUSED: &str = "07050b323f7cab00";
const STREAM_ELLIPSES: &str = "071a043d2c99f600";
const ELLIPSES: &str = "1315ac02c08db701502c01fbffc409be0a85ff010101010101010101010101010101010101010101010101010101010101010101010101010101010101010101010101010101010101010101010101010101010101010101058c9859a700";
const ELLIPSE_RATE: &str = "08050d04ada1494b00";
const STREAM: &str = "0701012813c52f00";
const ACKNOWLEDGE: &str = "07022911e85d3100";
const GET_STATUS: &str = "060337be0b4b00";
const TISSUE_IN_FORCE: &str = "0f04c395a3cf0a6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44810409c459a99993fcdcc4c3f3c517a1800";
const NOT_UNDERSTOOD: &str = "020505bae6ae3c00";
const TISSUE_ID: &str = "0705012cd6a94b00";
const TISSUE_VALUES: &str = "08050205f48dd6bb00";
const SET_TISSUE: &str = "0f04c395a3cf0a6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44814409c459a99993fcdcc4c3f6f12033ba69b443c0424f44810409c459a99993fcdcc4c3f3c517a1800";
const GET_TISSUE: &str = "0605021b68a200";
const TIME: &str = "0a06e807ac0226ef5ab300";
const GET_TIME: &str = "0806e807e7490ff300";
const NOT_STORED: &str = "03050304b7a7a500";
const BUSY: &str = "070504a322c33b00";
const SERIAL: &str = "0705053512c44c00";
const CALIBRATION: &str = "0705068f43cdd500";
const IDENTITY: &str = "090801502d3030303101010101010101010107ac021276e54d00";
const BLOCK_STORED: &str = "0709030cf8120900";
const GET_IDENTITY: &str = "06092957deab00";
const SET_IDENTITY: &str = "090a01502d3030303101010101010101010105344ec81f00";
const SET_BLOCK: &str = "050b03ac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020105c03fac020107c03fa4b7df0900";
const SET_CALIBRATION: &str = "0e0c07f001f8acd19101346e354900";
const RESTART: &str = "060d3093b3ac00";
const FAULTS_FOUND: &str = "150703080102030405060708080706050403020103060103e05d040eac02c865010205b06de8d56b0e00";
const GET_FAULTS: &str = "0608bf67d9dc00";
const BEGIN: &str = "020e0e706c616e74617231626f6172640101010101010101010106312e322e330101010101010101010147ac0201010101010101010101010101010101010101010101010101010101010101010202020202020202020202020202020202020202020202020202020202020202eb650d0800";
const CHUNK: &str = "ff0e01ac02070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070707070b07070707070720840f5500";
const FINISH: &str = "070e025d5e543100";
const NEXT: &str = "020a07ac02b1ad45a200";
const ACCEPTED: &str = "070a01e3ca31cc00";
const UPDATE_REFUSED: &str = "080507079d18af2800";
const SET_CLOCK: &str = "0e078080f9c0c1c48203c9aa264a00";

/// Values outside the range of their field are limited to that range.
#[test]
fn live_values_are_rounded_and_limited() {
    let mut insole = Insole::<f64, 1>::new();
    insole.set_up(testkit::SETUP, [cell(Region::Heel, 0.0, 0.0, 25.0)].into_iter()).expect("the set-up is accepted");
    let mut loads = *insole.loads();
    // Force in N, and the value in the message in 0.1 N.
    let cases = [
        (0.0, 0),
        (0.04, 0),
        (0.06, 1),
        (123.44, 1234),
        (123.46, 1235),
        (6553.5, 65535),
        (1e9, 65535),
        (-5.0, 0),
        (f64::NAN, 0),
    ];
    for (force_n, message_dn) in cases {
        loads[3].tissue.model_n = force_n;
        loads[3].tissue.deformation_m = force_n * 1e-7;
        loads[3].frame =
            RegionFrame { force: ForceMoments { force_n, ..ForceMoments::NONE }, saturated: true, ..RegionFrame::NONE };
        loads[5].tissue.clamped = true;
        let live = Live::new(9, 10, &loads, 1 << 6, Some((12.34, 56.78)));
        let deformation_um = (force_n * 0.1).max(0.0).round().min(65535.0) as u16;
        let region = LiveRegion { area_mm2: 0, deformation_um, model_dn: message_dn, measured_dn: message_dn };
        assert_eq!(live.regions[3], region, "{force_n} N");
        assert_eq!((live.sequence, live.t_us), (9, 10));
        assert_eq!((live.saturated, live.clamped, live.masked), (1 << 3, 1 << 5, 1 << 6));
        assert_eq!((live.centre_x_dmm, live.centre_y_dmm), (123, 568));
    }
}

/// The emulated board refuses a set-up file that ends within the configuration or within a cell.
#[test]
fn a_truncated_set_up_is_refused() {
    use emulation::{EmulatorConfig, read_setup};
    let setup = Setup {
        side: Side::Left,
        layout_id: 1,
        period_us: 10_000,
        sensor: plantar::pipeline::calibrate::SensorLaw { full_kpa: 1000.0, exponent: 0.8 },
        contact: ContactRule::COUNTED,
        stance: plantar::pipeline::stance_rule::StanceRule::ADAPTIVE,
    };
    let cells = [cell(Region::Heel, 10.0, 10.0, 100.0), cell(Region::Hallux, 10.0, 200.0, 100.0)];
    let mut bytes = encoded(&EmulatorConfig::new(setup));
    let config_len = bytes.len();
    bytes.extend(cells.iter().flat_map(encoded));
    let file = |len: usize| {
        let bytes = &bytes[..len];
        read_setup(move |offset, buffer| bytes.get(offset..).and_then(|mut rest| rest.read(buffer).ok()))
    };
    let (config, read) = file(bytes.len()).expect("the set-up is complete");
    assert_eq!((config.setup, read.collect::<Vec<_>>()), (setup, cells.to_vec()));
    // The file does not contain the number of cells: one that ends after the configuration or after the first cell is a set-up
    // with fewer cells.
    for len in (0..bytes.len()).filter(|&len| len != config_len && len != (config_len + bytes.len()) / 2) {
        assert!(file(len).is_none(), "{len} bytes");
    }
}
