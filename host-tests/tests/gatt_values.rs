//! The values of GATT characteristics: fragments of messages, cadence, and the characteristic Current Time. Two further tests
//! check the identifiers of services and characteristics, and the quantities of a step in files.

use plantar::pipeline::cadence::Cadence;
use plantar::protocol::current_time::{from_current_time, to_current_time};
use plantar::protocol::fragment::{FragmentError, Joiner, Splitter};
use plantar::protocol::gatt::{self, GattChannel};
use plantar::protocol::{MAX_MESSAGE, Status, Step, StepFoot, StepRegion, ToHost, encode};
use proptest::prelude::*;

fn fragments(message: &[u8], max_len: usize) -> Vec<Vec<u8>> {
    let mut splitter = Splitter::new();
    splitter.buffer()[..message.len()].copy_from_slice(message);
    splitter.start(message.len());
    let mut fragment = vec![0; max_len];
    std::iter::from_fn(|| splitter.next(&mut fragment).map(|len| fragment[..len].to_vec())).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn fragments_are_joined_to_the_same_message(
        message in prop::collection::vec(any::<u8>(), 1..=MAX_MESSAGE),
        max_len in 6..=244_usize,
    ) {
        let mut joiner = Joiner::new();
        let fragments = fragments(&message, max_len);
        let (last, others) = fragments.split_last().expect("a message has a fragment");
        for (number, fragment) in others.iter().enumerate() {
            prop_assert_eq!(usize::from(fragment[0]), number);
            prop_assert_eq!(joiner.push(fragment), Ok(None));
        }
        prop_assert_eq!(usize::from(last[0]), 0x80 | others.len());
        prop_assert_eq!(joiner.push(last), Ok(Some(&message[..])));
    }

    /// A message that contains its length is split without headers, and the message after it has them again.
    #[test]
    fn a_plain_message_is_split_without_headers(
        message in prop::collection::vec(any::<u8>(), 1..=MAX_MESSAGE),
        max_len in 6..=244_usize,
    ) {
        let mut splitter = Splitter::new();
        splitter.buffer()[..message.len()].copy_from_slice(&message);
        splitter.start_plain(message.len());
        let mut fragment = vec![0; max_len];
        let mut sent = Vec::new();
        while let Some(len) = splitter.next(&mut fragment) {
            prop_assert_eq!(len, max_len.min(message.len() - sent.len()));
            sent.extend_from_slice(&fragment[..len]);
        }
        prop_assert_eq!(&sent, &message);
        splitter.start(1);
        prop_assert_eq!(splitter.next(&mut fragment), Some(2));
        prop_assert_eq!(&fragment[..2], &[0x80, message[0]]);
    }

    #[test]
    fn a_joiner_works_after_any_fragments(fragments in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..300), 0..20)) {
        let mut joiner = Joiner::new();
        for fragment in fragments {
            let _ = joiner.push(&fragment);
        }
        prop_assert_eq!(joiner.push(&[0x80, 7]), Ok(Some(&[7][..])));
    }

    /// The times from the beginning of 1970 to the end of 9999.
    #[test]
    fn any_time_survives_the_conversion_to_current_time_and_back(unix_s in 0..253_402_300_800_u64) {
        let time = to_current_time(Some(unix_s * 1_000_000));
        prop_assert_eq!(from_current_time(&time), Some(unix_s * 1_000_000));
    }
}

#[test]
fn fragments_out_of_order_are_refused_and_the_next_message_is_accepted() {
    let mut joiner = Joiner::new();
    assert_eq!(joiner.push(&[]), Err(FragmentError::Empty));
    assert_eq!(joiner.push(&[0x01, 1]), Err(FragmentError::OutOfOrder));
    assert_eq!(joiner.push(&[0x00, 1]), Ok(None));
    assert_eq!(joiner.push(&[0x82, 2]), Err(FragmentError::OutOfOrder));
    assert_eq!(joiner.push(&[0x81, 2]), Err(FragmentError::OutOfOrder), "the incomplete message must be discarded");
    assert_eq!(joiner.push(&[0x00; MAX_MESSAGE]), Ok(None));
    assert_eq!(joiner.push(&[0x01; 3]), Err(FragmentError::TooLong));
    assert_eq!(joiner.push(&[0x80, 9]), Ok(Some(&[9][..])));
}

#[test]
fn current_time_follows_the_calendar() {
    assert_eq!(to_current_time(None), [0; 10]);
    assert_eq!(to_current_time(Some(0)), [0xb2, 0x07, 1, 1, 0, 0, 0, 4, 0, 0], "1 January 1970 was a Thursday");
    // Thursday, 29 February 2024, 12:34:56.5.
    assert_eq!(to_current_time(Some(1_709_210_096_500_000)), [0xe8, 0x07, 2, 29, 12, 34, 56, 4, 128, 0]);
    for wrong in [[0xe9, 0x07, 2, 29], [0xe8, 0x07, 13, 1], [0xe8, 0x07, 4, 31], [0xe8, 0x07, 1, 0], [0xb1, 0x07, 1, 1]]
    {
        assert_eq!(from_current_time(&[&wrong[..], &[0; 6]].concat()), None, "{wrong:?}");
    }
    assert_eq!(from_current_time(&[0; 9]), None);
}

#[test]
fn cadence_counts_the_steps_of_both_feet() {
    let mut cadence = Cadence::default();
    assert_eq!(cadence.per_min(0), 0);
    cadence.step(500_000, 650_000);
    assert_eq!(cadence.per_min(1_200_000), 0, "one step must have no cadence");
    cadence.step(1_600_000, 650_000);
    assert_eq!(cadence.per_min(2_300_000), 109);
    assert_eq!(cadence.per_min(5_500_000), 0, "a standing wearer must have no cadence");
    cadence.step(9_000_000, 650_000);
    assert_eq!(cadence.per_min(9_700_000), 0, "the first step of a new walk must have no cadence");
}

#[test]
fn slow_walkers_have_a_cadence_in_the_whole_stride() {
    let (stride_us, stance_us) = (2_990_000, 1_900_000);
    // The default rule confirms a toe off after 50 ms; then the step is added.
    let confirmed_us = 50_000;
    let mut cadence = Cadence::default();
    cadence.step(stride_us, stance_us);
    for step in 2..6 {
        let start_us = step * stride_us;
        cadence.step(start_us, stance_us);
        let added_us = start_us + u64::from(stance_us) + confirmed_us;
        for now_us in (added_us..=added_us + stride_us).step_by(10_000) {
            assert_eq!(cadence.per_min(now_us), 40, "{now_us}");
        }
    }
}

/// Hosts find the services by the UUIDs that docs/bluetooth.md states, and the kind of a message determines its characteristic.
#[test]
fn services_and_characteristics_have_the_documented_identifiers() {
    let text = include_str!("../../docs/bluetooth.md");
    let ours = [gatt::SERVICE, gatt::CONTROL, gatt::LIVE, gatt::STEPS, gatt::PARAMETERS];
    assert_eq!(ours, [0, 1, 2, 3, 4].map(|number| 0xdca8_c300_cb96_463f_8bec_f209_4e1c_cf7b + (number << 96)));
    assert!(text.contains("dca8c3xx-cb96-463f-8bec-f2094e1ccf7b"));
    for uuid in [gatt::MANAGEMENT_SERVICE, gatt::MANAGEMENT] {
        let digits = format!("{uuid:032X}");
        let parts = [&digits[..8], &digits[8..12], &digits[12..16], &digits[16..20], &digits[20..]];
        assert!(text.contains(&parts.join("-")), "{digits}");
    }
    let channel = |first: u8| GattChannel::of_message(&[first]);
    for (kinds, expected) in [
        (vec![ToHost::LIVE, ToHost::CELLS, ToHost::ELLIPSES], GattChannel::Live),
        (vec![ToHost::STEP, ToHost::BOUT, ToHost::ALERT], GattChannel::Steps),
        (vec![ToHost::TISSUE, ToHost::REFUSED], GattChannel::Parameters),
    ] {
        assert!(kinds.iter().all(|&kind| channel(kind) == expected), "{kinds:?}");
    }
    let of_status =
        encode(&ToHost::Status(Status::default()), &mut [0; MAX_MESSAGE]).map(|message| channel(message[0]));
    assert_eq!(of_status.ok(), Some(GattChannel::Control));
}

/// The quantities as files contain them: a value in its unit, its place in a JSON object, and the flags of a region.
#[test]
fn quantities_have_the_values_and_names_of_a_step() {
    let find = |name: &str| StepRegion::QUANTITIES.iter().find(|quantity| quantity.name == name).expect("a quantity");
    let region = StepRegion { measured_peak_dn: 1234, contact_ms: 500, ..StepRegion::default() };
    assert_eq!(find("measured_force_peak_n").in_unit(&region), Some(123.4));
    assert_eq!(find("contact_time_s").in_unit(&region), Some(0.5));
    assert_eq!(find("contact_time_s").path(), (None, "contact_time_s"));
    let foot = StepFoot::QUANTITIES.iter().find(|quantity| quantity.name == "gait_length_mm").expect("a quantity");
    assert_eq!(foot.path(), (Some("gait_line"), "length_mm"));
    let saturated = Step::FLAGS.iter().find(|flag| flag.name == "saturated").expect("a flag");
    let step = Step { saturated: 0b0000_0110, ..testkit::step(1) };
    assert_eq!([0, 1, 2, 3].map(|region| saturated.is_set(&step, region)), [false, true, true, false]);
}
