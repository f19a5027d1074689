//! The real firmware in QEMU and simulated phones, on a simulated radio link.
//!
//! `PLANTAR_FIRMWARE` contains the path of the firmware, and `PLANTAR_PYTHON` that of the Python interpreter that runs the
//! phones.

use crate::common::{firmware, replay, synthetic_walk, tissue};
use crate::phones::{
    BONDS_AT, CHARACTERISTICS, CONTROL, CURRENT_TIME, Insole, LIVE, MANAGEMENT, PARAMETERS, Phone, RSC_MEASUREMENT,
    RadioSimulation, STEPS, World, fragments,
};
use firmware_image::{Image, development_key};
use plantar::firmware::front_end::NOISE_CODES;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::update::{CHUNK, Header, Progress, Request};
use plantar::protocol::{Live, MAJOR, MINOR, Radio, Refusal, Step, ToDevice, ToHost, decode};
use plantar::storage::Bonds;
use plantar::storage::flash_map::HEADER;
use plantar::{Region, Side};
use recording::{Recording, synthetic};
use serde_json::{Value, json};
use std::time::Instant;

// Error codes of the attribute protocol. The codes from 0x80 on are defined by the insole.
const INSUFFICIENT_AUTHENTICATION: u64 = 0x05;
const INVALID_LENGTH: u64 = 0x0d;
const INSUFFICIENT_ENCRYPTION: u64 = 0x0f;
const VALUE_NOT_ALLOWED: u64 = 0x13;
const OUT_OF_ORDER: u64 = 0x80;
const NOT_UNDERSTOOD: u64 = 0x81;

/// Stack that a pairing may use, bytes: the constant of this name in `tools/xtask/src/bench.rs`, with which the RAM of all boards
/// is compared with its limit.
const PAIRING_STACK_BYTES: u32 = 9_728;

/// A computed walk of this number of steps.
const WALK: fn(usize) -> Recording = |steps| synthetic_walk(steps, 100.0);

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn an_unbonded_phone_reads_values_of_standard_services_and_nothing_else() {
    let mut world = World::start_with(WALK(1), |config| config.battery_percent = Some(73));
    let mut phone = world.new_phone(1);
    let table = phone.connect(&mut world.radio, 247);
    // Bits of the properties of a characteristic.
    let (read, command, write, notify, indicate) = (0x02, 0x04, 0x08, 0x10, 0x20);
    let expected: Vec<(&str, Vec<(&str, u64)>)> = vec![
        ("1800", vec![("2a00", read), ("2a01", read)]),
        ("1801", vec![]),
        (
            "dca8c300-cb96-463f-8bec-f2094e1ccf7b",
            vec![(CONTROL, write | indicate), (LIVE, notify), (STEPS, notify), (PARAMETERS, write | indicate)],
        ),
        ("8d53dc1d-1db7-4cd3-868b-8a527460aa84", vec![(MANAGEMENT, command | notify)]),
        ("1805", vec![(CURRENT_TIME, read | write | notify)]),
        ("1814", vec![(RSC_MEASUREMENT, notify), ("2a54", read)]),
        ("180a", vec![("2a29", read), ("2a24", read), ("2a26", read)]),
        ("180f", vec![("2a19", read)]),
    ];
    // A bonded phone may remember the handles, so those of the insole's service never change. Each service has a handle, each
    // characteristic one before that of its value, and each descriptor one.
    let mut handle = 0;
    let expected: Value = expected
        .into_iter()
        .map(|(uuid, characteristics)| {
            handle += 1;
            let characteristics: Value = characteristics
                .into_iter()
                .map(|(uuid, properties)| {
                    let descriptors: &[&str] = if properties & (notify | indicate) != 0 { &["2902"] } else { &[] };
                    let value_handle = handle + 2;
                    handle = value_handle + descriptors.len();
                    json!({"uuid": uuid, "handle": value_handle, "properties": properties, "descriptors": descriptors})
                })
                .collect();
            json!({"uuid": uuid, "characteristics": characteristics})
        })
        .collect();
    assert_eq!(table, expected, "{table:#}");
    // The control characteristic of the insole's service.
    assert_eq!(table[2]["characteristics"][0]["handle"], 9);

    assert_eq!(phone.read(&mut world.radio, "2a00"), b"Plantar L");
    assert_eq!(phone.read(&mut world.radio, "2a29"), b"Plantar");
    assert_eq!(phone.read(&mut world.radio, "2a24"), b"emulated");
    assert_eq!(phone.read(&mut world.radio, "2a26"), env!("PLANTAR_VERSION").as_bytes());
    assert_eq!(phone.read(&mut world.radio, "2a19"), [73]);
    assert_eq!(phone.read(&mut world.radio, CURRENT_TIME), [0; 10], "the clock must not be set yet");
    assert_eq!(phone.read(&mut world.radio, "2a54"), [0, 0]);
    // A write without a response must not be answered, even if it is not permitted.
    assert_eq!(phone.command_and_read(&mut world.radio, "2a54", &[1, 0]), [0, 0]);

    let connect = fragments(&ToDevice::Connect { major: MAJOR, minor: MINOR }, 20).remove(0);
    for characteristic in [CONTROL, PARAMETERS, CURRENT_TIME] {
        assert_eq!(
            phone.refused(&mut world.radio, characteristic, &connect),
            Some(INSUFFICIENT_AUTHENTICATION),
            "{characteristic}"
        );
    }
    // A generic app pairs once its subscription to the cadence is refused.
    for characteristic in CHARACTERISTICS.into_iter().chain([MANAGEMENT, RSC_MEASUREMENT]) {
        let subscribed = world.radio.try_request(json!({"do": "subscribe", "phone": phone.name, "to": characteristic}));
        assert_eq!(
            subscribed.expect_err("the subscription must be refused").att,
            Some(INSUFFICIENT_AUTHENTICATION),
            "{characteristic}"
        );
        assert!(world.radio.try_request(json!({"do": "read", "phone": phone.name, "of": characteristic})).is_err());
    }
    assert_eq!(world.insole.bonds(), None);
}

/// Plays the complete walk of each insole, streams it to the insole's phone, and compares every message with a replay.
fn assert_stream_equals_replay(radio: &mut RadioSimulation, feet: &mut [(&Insole, &mut Phone)]) {
    let mut got = vec![(Vec::<Live>::new(), Vec::<Step>::new()); feet.len()];
    let mut expected = Vec::new();
    for (insole, phone) in feet.iter_mut() {
        phone.set_tissue(radio, tissue());
        phone.send(radio, ToDevice::Stream { live: true });
        expected.push(replay(&insole.recording, ContactRule::COUNTED, |_| false));
    }
    let is_complete = |got: &(Vec<Live>, Vec<Step>), expected: &(Vec<Live>, Vec<Step>)| {
        got.0.len() >= expected.0.len() && got.1.len() >= expected.1.len()
    };
    while got.iter().zip(&expected).any(|(got, expected)| !is_complete(got, expected)) {
        for (((insole, phone), got), expected) in feet.iter_mut().zip(&mut got).zip(&expected) {
            if is_complete(got, expected) {
                continue;
            }
            // The insole queues at most eight live frames, so the walk is at most six frames ahead of the phone.
            insole.play(got.0.len() as u32 + 6);
            match phone.next(radio) {
                ToHost::Live(live) => got.0.push(live),
                ToHost::Step(step) => {
                    phone.send(radio, ToDevice::Acknowledge { number: step.step });
                    got.1.push(step);
                }
                other => panic!("{other:?}"),
            }
        }
    }
    for (((insole, phone), got), expected) in feet.iter_mut().zip(&got).zip(&expected) {
        assert_eq!(got.1, expected.1);
        assert_eq!(got.0, expected.0);
        let status = phone.status(radio);
        let scans = insole.scans();
        assert_eq!((status.live_due, status.live_sent, status.bad_frames), (scans, scans, 0));
    }
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn a_bonded_phone_receives_every_frame_and_step_of_a_walk() {
    let mut world = World::start(WALK(3));
    let mut phone = world.bonded_phone(247);
    let begin = Instant::now();
    assert_stream_equals_replay(&mut world.radio, &mut [(&world.insole, &mut phone)]);
    // A live frame for each scan, and two fragments for each of the three steps.
    let values = f64::from(world.insole.scans()) + 6.0;
    println!("{:.0} notifications a second, nearly all of them live frames", values / begin.elapsed().as_secs_f64());
    let stack_bytes = phone.status(&mut world.radio).stack_bytes;
    println!("deepest stack with a pairing: {stack_bytes} bytes");
    assert!(stack_bytes <= PAIRING_STACK_BYTES, "{stack_bytes} bytes");
}

/// The phone accepts only what Apple's guidelines for accessories allow: an interval of at least 15 ms and a range of at least
/// 15 ms, a latency of at most 30, and a timeout of 2 to 6 s that is longer than three times the effective interval.
#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn an_insole_requests_a_link_for_its_live_stream() {
    let mut world = World::start(WALK(1));
    let phone = world.bonded_phone(247);
    let requested = world.radio.request(json!({"do": "requested_link", "phone": phone.name}));
    let link: Vec<u64> = serde_json::from_value(requested["link"].clone()).expect("four numbers");
    let &[shortest, longest, latency, timeout] = &link[..] else { panic!("{link:?}") };
    let (shortest_ms, longest_ms, timeout_ms) = (1.25 * shortest as f64, 1.25 * longest as f64, 10.0 * timeout as f64);
    assert!(shortest_ms >= 15.0 && longest_ms >= shortest_ms + 15.0, "{link:?}");
    assert!(latency <= 30 && (2_000.0..=6_000.0).contains(&timeout_ms), "{link:?}");
    assert!(timeout_ms > 3.0 * longest_ms * (latency + 1) as f64, "{link:?}");
    // At 100 Hz, three frames wait for each event, which is the number of packets that the nRF52840 holds.
    assert!(longest_ms <= 30.0, "{link:?}");
}

/// A phone finds an insole that is not worn, which scans twice a second. From the first load on, the insole scans every frame.
#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn an_insole_that_is_not_worn_is_found_and_measures_when_it_is_put_on() {
    /// Time for which the insole is not worn, s.
    const UNWORN_S: usize = 70;
    let mut recording = WALK(3);
    let unworn = UNWORN_S * recording.rate_hz as usize;
    recording.pressure_kpa.splice(..0, vec![0.0; unworn * recording.cells()]);
    recording.t_s = (0..recording.frames() + unworn).map(|frame| frame as f64 / recording.rate_hz).collect();
    // An insole on which nobody stands reads small offsets, and the noise of its converter.
    let offsets_kpa = vec![0.05; recording.cells()];
    synthetic::add_sensor_errors(&mut recording, &offsets_kpa, NOISE_CODES, 7);
    let mut world = World::start(recording);
    world.insole.play(unworn as u32);
    let mut phone = world.bonded_phone(247);
    let mut status = phone.status(&mut world.radio);
    while (status.frame_times() as usize) < unworn - 100 {
        status = phone.status(&mut world.radio);
    }
    // The insole counts as not worn after 60 s. From then on one frame in 50 is scanned.
    assert!(!status.is_worn && (800..=1000).contains(&status.frames_skipped), "{status:?}");
    phone.send(&mut world.radio, ToDevice::Stream { live: true });
    // An insole that is not worn scans every 50th frame. The 101 frames after the time without load include a scan in the first
    // stance, by which the insole recognises that it is worn.
    world.insole.play(unworn as u32 + 101);
    while !status.is_worn {
        status = phone.status(&mut world.radio);
    }
    world.insole.play(world.insole.scans());
    let mut steps = 0;
    while steps < 2 {
        if let ToHost::Step(_) = phone.next(&mut world.radio) {
            steps += 1;
        }
    }
    let worn = phone.status(&mut world.radio);
    assert!(worn.is_worn && worn.frames_skipped <= status.frames_skipped + 200, "{worn:?}");
    assert_eq!((worn.frames_missed, worn.frames_overrun), (0, 0));
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn messages_are_the_same_with_the_smallest_mtu() {
    let mut world = World::start(WALK(1));
    let mut phone = world.bonded_phone(23);
    assert_stream_equals_replay(&mut world.radio, &mut [(&world.insole, &mut phone)]);
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn a_bond_survives_a_reset_and_a_wrong_key_is_refused() {
    let mut world = World::start(WALK(1));
    let mut phone = world.bonded_phone(247);
    let bonds = world.insole.bonds().expect("the insole has a bond");
    // Bonding is closed after this reset, so that only the existing bond gives access.
    world.restart(|config| config.bonding_s = 0);
    let table = phone.connect(&mut world.radio, 247);
    let mut services = table.as_array().expect("the services").iter().map(|service| &service["uuid"]);
    assert!(services.all(|uuid| uuid != "180f"), "a board that does not measure its battery must not state its charge");
    let connect = fragments(&ToDevice::Connect { major: MAJOR, minor: MINOR }, 20).remove(0);
    assert_eq!(phone.refused(&mut world.radio, CONTROL, &connect), Some(INSUFFICIENT_ENCRYPTION));
    world.radio.request(json!({"do": "encrypt", "phone": phone.name}));
    phone.open(&mut world.radio);
    assert_stream_equals_replay(&mut world.radio, &mut [(&world.insole, &mut phone)]);
    assert_eq!(world.insole.bonds(), Some(bonds));
    phone.disconnect(&mut world.radio);

    phone.connect(&mut world.radio, 23);
    world.radio.request(json!({"do": "spoil_key", "phone": phone.name}));
    world.radio.try_request(json!({"do": "encrypt", "phone": phone.name})).expect_err("a wrong key must be refused");
    world.radio.discard_events();
    // Other phones can connect to the insole again.
    let mut other = world.new_phone(2);
    other.connect(&mut world.radio, 23);
    assert_eq!(other.refused(&mut world.radio, CONTROL, &connect), Some(INSUFFICIENT_AUTHENTICATION));
}

/// The address at which a phone finds the insole.
fn address_of(world: &mut World, phone: &Phone) -> String {
    let found = world.radio.request(json!({"do": "scan", "phone": phone.name, "name": "Plantar L"}));
    found["address"].as_str().expect("an address").to_owned()
}

/// True if an address is a resolvable private one: its two most significant bits are 01.
fn is_private(address: &str) -> bool {
    u8::from_str_radix(&address[..2], 16).expect("hexadecimal digits") >> 6 == 0b01
}

/// A stranger sees a new address after each start. A bonded phone recognises the insole, because it has the key from which the
/// addresses are derived. If the bonds are older than this key, the insole does not change the address that its phones know.
#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn a_stranger_cannot_recognise_an_insole_by_its_address() {
    let mut world = World::start(WALK(1));
    let mut phone = world.bonded_phone(247);
    let stranger = world.new_phone(2);
    phone.disconnect(&mut world.radio);
    let first = address_of(&mut world, &stranger);
    let Bonds(keys) = world.insole.bonds().expect("the insole has a bond");
    world.restart(|config| config.bonding_s = 0);
    let second = address_of(&mut world, &stranger);
    assert!(is_private(&first) && is_private(&second) && first != second, "{first} {second}");
    // The link is encrypted with the keys of the first pairing, so the phone has recognised the insole at its new address.
    phone.reopen(&mut world.radio, 247);
    assert_stream_equals_replay(&mut world.radio, &mut [(&world.insole, &mut phone)]);
    phone.disconnect(&mut world.radio);

    // Version 1 of the stored keys has the bonds only, and a checksum.
    let mut version_1 = vec![1];
    version_1.extend(&keys[BONDS_AT..keys.len() - 4]);
    version_1.extend(plantar::checksum::crc32(&version_1).to_le_bytes());
    let chip = world.insole.flash_with_keys(&Bonds(version_1.iter().copied().collect()));
    world.restart_with(|config| config.bonding_s = 0, chip);
    let fixed = address_of(&mut world, &stranger);
    world.restart(|_| {});
    let again = address_of(&mut world, &stranger);
    assert!(!is_private(&fixed) && fixed == again, "{fixed} {again}");
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn phones_bond_only_while_bonding_is_open() {
    let mut world = World::start(WALK(1));
    let mut phone = world.bonded_phone(23);
    world.restart(|config| config.bonding_s = 0);
    let bonds = world.insole.bonds();
    world.radio.request(json!({"do": "forget", "phone": phone.name}));
    let mut other = world.new_phone(2);
    for phone in [&mut phone, &mut other] {
        phone.connect(&mut world.radio, 23);
        world
            .radio
            .try_request(json!({"do": "pair", "phone": phone.name}))
            .expect_err("pairing must be refused while bonding is closed");
        let connect = fragments(&ToDevice::Connect { major: MAJOR, minor: MINOR }, 20).remove(0);
        assert!(phone.write(&mut world.radio, CONTROL, &connect).is_err());
        phone.disconnect(&mut world.radio);
    }
    assert_eq!(world.insole.bonds(), bonds);

    world.restart(|_| {});
    phone.connect(&mut world.radio, 23);
    world.radio.request(json!({"do": "pair", "phone": phone.name}));
    phone.open(&mut world.radio);
    assert_ne!(world.insole.bonds(), bonds);
}

/// A phone that pairs without bonding has an encrypted link, but no more access than an unknown one.
#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn a_phone_that_pairs_without_bonding_has_no_access() {
    let mut world = World::start(WALK(1));
    let mut phone = world.new_phone(1);
    world.radio.request(json!({"do": "phone", "name": phone.name, "address": "D0:00:00:00:00:01", "bonding": false}));
    phone.connect(&mut world.radio, 23);
    world.radio.request(json!({"do": "pair", "phone": phone.name}));
    let connect = fragments(&ToDevice::Connect { major: MAJOR, minor: MINOR }, 20).remove(0);
    assert_eq!(phone.refused(&mut world.radio, CONTROL, &connect), Some(INSUFFICIENT_AUTHENTICATION));
    assert_eq!(world.insole.bonds(), None);
}

/// The fifth bond replaces the least recently used one, which is not the oldest one here.
#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn four_bonds_are_stored() {
    let mut world = World::start(WALK(1));
    let mut phones: Vec<_> = (1..=5).map(|number| world.new_phone(number)).collect();
    let bond = |world: &mut World, phone: &mut Phone| {
        phone.connect(&mut world.radio, 23);
        world.radio.request(json!({"do": "pair", "phone": phone.name}));
        phone.open(&mut world.radio);
        phone.disconnect(&mut world.radio);
    };
    for phone in &mut phones[..4] {
        bond(&mut world, phone);
    }
    phones[0].reopen(&mut world.radio, 23);
    phones[0].disconnect(&mut world.radio);
    bond(&mut world, &mut phones[4]);
    world.restart(|config| config.bonding_s = 0);
    let mut replaced = phones.remove(1);
    for phone in &mut phones {
        phone.reopen(&mut world.radio, 23);
        phone.disconnect(&mut world.radio);
    }
    replaced.connect(&mut world.radio, 23);
    world
        .radio
        .try_request(json!({"do": "encrypt", "phone": replaced.name}))
        .expect_err("the least recently used bond must be deleted");
}

/// The steps that a phone has stored. A step that arrives again is not stored again.
#[derive(Default)]
struct StoredSteps(Vec<Step>);

impl StoredSteps {
    /// Stores a step, unless it was stored before.
    fn add(&mut self, step: Step) {
        if self.0.last().is_none_or(|last| step.step > last.step) {
            self.0.push(step);
        }
    }
}

/// Plays a walk to a phone whose link breaks at moments that follow from `seed`. Every step must arrive.
fn break_links(seed: u32) {
    const STEPS: usize = 150;
    const CUTS: u32 = 50;
    /// Number of steps by which the walk may be ahead of the phone. The insole queues six steps in RAM and stores thousands.
    const AHEAD: u32 = 8;
    let mut world = World::start(WALK(STEPS));
    let (_, steps) = replay(&world.insole.recording, ContactRule::COUNTED, |_| false);
    assert_eq!(steps.len(), STEPS);
    let scans_per_step = world.insole.scans() / STEPS as u32;
    let mut phone = world.bonded_phone(247);
    phone.set_tissue(&mut world.radio, tissue());
    let (mut stored, mut cuts, mut random) = (StoredSteps::default(), 0, seed);
    while cuts < CUTS || stored.0.len() < STEPS {
        // The link is cut after a random number of values, within a message or between two. Every fourth session has live frames.
        phone.send(&mut world.radio, ToDevice::Stream { live: cuts % 4 == 3 });
        // The generator of Numerical Recipes. Its upper bits are the most random ones.
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        for _ in 0..random >> 28 {
            if stored.0.len() == STEPS {
                break;
            }
            world.insole.play((stored.0.len() as u32 + AHEAD) * scans_per_step);
            let (characteristic, value) = phone.value(&mut world.radio);
            let joiner = phone.joiners.entry(characteristic).or_default();
            if let Some(message) = joiner.push(&value).expect("fragments arrive in order")
                && let Some(ToHost::Step(step)) = decode(message)
            {
                stored.add(step);
                // Every other step is not acknowledged, as if the acknowledgement were lost with the link.
                if step.step % 2 == 1 {
                    phone.send(&mut world.radio, ToDevice::Acknowledge { number: step.step });
                }
            }
        }
        phone.cut(&mut world.radio);
        cuts += 1;
        // A step message has two fragments, or more than twenty with the smallest MTU.
        phone.reopen(&mut world.radio, if cuts % 8 == 0 { 23 } else { 247 });
    }
    println!("{cuts} cuts, {} steps", stored.0.len());
    assert_eq!(stored.0, steps);
    let status = phone.status(&mut world.radio);
    assert_eq!((status.steps, status.records_dropped, status.radio), (STEPS as u32, 0, Radio::Answers));
}

// Two tests with different seeds instead of one with twice the steps: each takes a minute, and they can run in parallel.

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn links_that_break_at_any_moment_lose_no_step() {
    break_links(1);
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn links_that_break_at_other_moments_lose_no_step() {
    break_links(2);
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn malformed_values_are_refused_and_the_session_continues() {
    let mut world = World::start(WALK(1));
    let mut phone = world.bonded_phone(247);
    let mut refused = |characteristic: &str, value: &[u8]| phone.refused(&mut world.radio, characteristic, value);
    assert_eq!(refused(CONTROL, &[]), Some(INVALID_LENGTH));
    assert_eq!(refused(CONTROL, &[0x80]), Some(NOT_UNDERSTOOD), "an empty message");
    assert_eq!(refused(CONTROL, &[0x80, 99]), Some(NOT_UNDERSTOOD), "an unknown message");
    assert_eq!(refused(CONTROL, &[0x81, 3]), Some(OUT_OF_ORDER), "a second fragment without a first one");
    assert_eq!(refused(CONTROL, &[0x80, 5]), Some(NOT_UNDERSTOOD), "parameters on the control point");
    assert_eq!(refused(PARAMETERS, &[0x80, 3]), Some(NOT_UNDERSTOOD), "a control message on the parameters");
    assert_eq!(refused(CURRENT_TIME, &[0xff; 10]), Some(VALUE_NOT_ALLOWED));
    assert_eq!(refused(CURRENT_TIME, &[0; 9]), Some(VALUE_NOT_ALLOWED));
    // The first fragment is written to one characteristic, the second to another.
    phone.write(&mut world.radio, PARAMETERS, &[0x00, 4]).expect("the first fragment is accepted");
    assert_eq!(phone.refused(&mut world.radio, CONTROL, &[0x81, 0]), Some(OUT_OF_ORDER));
    // Together the fragments are longer than any message.
    phone.write(&mut world.radio, PARAMETERS, &[0x00; 244]).expect("the first fragment is accepted");
    phone.write(&mut world.radio, PARAMETERS, &[0x01; 244]).expect("the second fragment is accepted");
    assert_eq!(phone.refused(&mut world.radio, PARAMETERS, &[0x02; 244]), Some(INVALID_LENGTH));
    let mut bad = tissue();
    bad.id ^= 1;
    assert_eq!(phone.answer(&mut world.radio, ToDevice::SetTissue(bad)), ToHost::Refused(Refusal::TissueId));
    let mut force_laws = tissue().force_laws;
    force_laws[5].n = 99.0;
    let refusal = ToHost::Refused(Refusal::Tissue(Region::Hallux));
    assert_eq!(phone.answer(&mut world.radio, ToDevice::SetTissue(Tissue::new(force_laws))), refusal);
    // The ten refused values count as bad frames. The two refused requests do not, because they could be decoded.
    assert_eq!(phone.status(&mut world.radio).bad_frames, 10);
    stream_steps(&mut world, &mut phone, 1);
}

/// Packets of 1 to 24 bytes with each code of the attribute protocol, of signalling and of pairing, filled with 0x01 or 0xff, do
/// not restart the insole.
#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn no_packet_of_a_stranger_restarts_the_insole() {
    let mut world = World::start(WALK(1));
    let mut owner = world.bonded_phone(247);
    let before = owner.status(&mut world.radio);
    owner.disconnect(&mut world.radio);
    let mut stranger = world.new_phone(2);
    for filler in [0x01, 0xff] {
        // The insole disconnects a stranger for some packets of pairing, so each code of pairing has a connection of its own.
        for (channel, codes, connection_codes) in [(4, 256, 64), (5, 256, 64), (6, 16, 1)] {
            for first in (0..codes).step_by(connection_codes) {
                let contents = (first..first + connection_codes)
                    .flat_map(|code| (0..=23).map(move |len| [vec![code as u8], vec![filler; len]].concat()));
                stranger.connect_without_discovery(&mut world.radio, 247);
                stranger.packets(&mut world.radio, channel, &contents.collect::<Vec<_>>());
                stranger.cut(&mut world.radio);
            }
        }
    }
    // Without the filter in `bluetooth/src/gate.rs`, a Read By Group Type request with a 128-bit UUID would make the Bluetooth
    // host panic. The loop above has sent such a request, but a full queue may have dropped it, so it is sent again.
    stranger.connect_without_discovery(&mut world.radio, 247);
    stranger.packets(&mut world.radio, 4, &[[&[0x10, 1, 0, 0xff, 0xff][..], &[0; 16]].concat()]);
    stranger.cut(&mut world.radio);
    owner.reopen(&mut world.radio, 247);
    let after = owner.status(&mut world.radio);
    assert!(!after.is_after_restart(&before), "{before:?}, {after:?}");
    stream_steps(&mut world, &mut owner, 1);
}

/// A stranger can copy the address of a bonded phone, and receives nothing before the link is encrypted, although the insole
/// remembers the subscriptions of this address.
#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn nothing_is_notified_before_the_link_is_encrypted() {
    let mut world = World::start(WALK(4));
    let mut phone = world.bonded_phone(247);
    world.radio.request(json!({"do": "subscribe", "phone": phone.name, "to": RSC_MEASUREMENT}));
    phone.disconnect(&mut world.radio);
    phone.connect_without_discovery(&mut world.radio, 247);
    world.radio.request(json!({"do": "listen", "phone": phone.name}));
    // The number of notifications after this number of scans, and after further packets have passed in both directions.
    let notified = |world: &mut World, phone: &Phone, scans: u32| {
        world.insole.play(scans);
        let mut further = 50;
        while further > 0 {
            phone.read(&mut world.radio, CURRENT_TIME);
            further -= u32::from(world.insole.board.plant().scans() >= scans);
        }
        world.radio.events.iter().filter(|(_, line)| line.get("notified").is_some()).count()
    };
    let scans = world.insole.scans();
    assert_eq!(notified(&mut world, &phone, scans / 2), 0);
    world.radio.request(json!({"do": "encrypt", "phone": phone.name}));
    assert!(notified(&mut world, &phone, scans) > 0);
}

/// A central may request an ATT MTU that is too short for any value.
#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn an_att_mtu_below_the_least_valid_one_does_not_restart_the_insole() {
    const EXCHANGE_MTU: u8 = 0x02;
    let mut world = World::start(WALK(1));
    let mut owner = world.bonded_phone(247);
    let before = owner.status(&mut world.radio);
    owner.disconnect(&mut world.radio);
    // This phone never subscribes, so that the insole does not wait for a confirmation of its answers.
    let mut phone = world.new_phone(2);
    phone.connect(&mut world.radio, 23);
    world.radio.request(json!({"do": "pair", "phone": phone.name}));
    for mtu in [0, 1, 4, 22] {
        phone.packets(&mut world.radio, 4, &[vec![EXCHANGE_MTU, mtu, 0]]);
        phone.send(&mut world.radio, ToDevice::Connect { major: MAJOR, minor: MINOR });
        phone.read(&mut world.radio, CURRENT_TIME);
        phone.disconnect(&mut world.radio);
        phone.connect_without_discovery(&mut world.radio, 23);
        world.radio.request(json!({"do": "encrypt", "phone": phone.name}));
    }
    phone.disconnect(&mut world.radio);
    owner.reopen(&mut world.radio, 247);
    let after = owner.status(&mut world.radio);
    assert!(!after.is_after_restart(&before), "{before:?}, {after:?}");
    stream_steps(&mut world, &mut owner, 1);
}

/// Plays the walk to its end, and waits for this number of steps.
fn stream_steps(world: &mut World, phone: &mut Phone, steps: usize) {
    world.insole.play(u32::MAX);
    for _ in 0..steps {
        assert!(matches!(phone.next(&mut world.radio), ToHost::Step(_)));
    }
}

/// The insole disconnects a phone that does not confirm an indication within 30 s.
#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn a_phone_that_never_confirms_is_disconnected_and_can_connect_again() {
    let mut world = World::start(WALK(1));
    let mut phone = world.bonded_phone(247);
    world.radio.request(json!({"do": "mute", "phone": phone.name}));
    phone.send(&mut world.radio, ToDevice::GetStatus);
    phone.wait_for_disconnection(&mut world.radio);
    phone.reopen(&mut world.radio, 247);
    assert_eq!(phone.status(&mut world.radio).bad_frames, 0);
    stream_steps(&mut world, &mut phone, 1);
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn standard_services_report_the_cadence_and_set_the_clock() {
    let mut world = World::start(WALK(3));
    let mut phone = world.bonded_phone(247);
    world.radio.request(json!({"do": "subscribe", "phone": phone.name, "to": RSC_MEASUREMENT}));
    let (_, steps) = replay(&world.insole.recording, ContactRule::COUNTED, |_| false);
    world.insole.play(u32::MAX);
    let mut measured = Vec::new();
    while measured.len() < 3 {
        let (characteristic, value) = phone.value(&mut world.radio);
        if characteristic == RSC_MEASUREMENT {
            assert_eq!((value.len(), &value[..3]), (4, &[0, 0, 0][..]));
            measured.push(value[3]);
        }
    }
    let cadence = |i: usize| (120_000_000 / (steps[i].start_us - steps[i - 1].start_us)) as u8;
    assert_eq!(measured, [0, cadence(1), cadence(2)]);

    // The time is set to Wednesday, 29 February 2040, 23:59:30.
    let written = [0xf8, 0x07, 2, 29, 23, 59, 30, 3, 0, 0];
    phone.write(&mut world.radio, CURRENT_TIME, &written).expect("the time is valid");
    let read = phone.read(&mut world.radio, CURRENT_TIME);
    assert_eq!((&read[..6], read[7]), (&written[..6], 3));
    assert!(read[6] >= 30);
    // The clock is set to 2040-03-01 00:00:00.
    phone.send(&mut world.radio, ToDevice::SetClock { unix_us: 2_214_172_800_000_000 });
    assert_eq!(phone.read(&mut world.radio, CURRENT_TIME)[..6], [0xf8, 0x07, 3, 1, 0, 0]);
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn a_request_for_the_time_is_answered_with_the_times_of_host_and_insole() {
    let mut world = World::start(WALK(1));
    let mut phone = world.bonded_phone(247);
    let mut before_us = 0;
    for host_us in 0..20 {
        let answer = phone.answer(&mut world.radio, ToDevice::GetTime { host_us });
        let ToHost::Time { host_us: echoed_us, device_us } = answer else { panic!("{answer:?}") };
        assert_eq!(echoed_us, host_us);
        assert!(device_us > before_us, "the insole's time must increase");
        before_us = device_us;
    }
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn both_insoles_stream_at_once() {
    let mut world = World::start(WALK(5));
    let walk = synthetic::walk(&synthetic::SyntheticWalk { steps: 5, side: Side::Right, ..Default::default() });
    let firmware = firmware();
    let right = Insole::boot(&mut world.radio, &firmware, walk.recording, |_| {}, None);
    let mut phone = world.bonded_phone(247);
    let mut other = world.radio.bonded_phone(2, "Plantar R", 247);
    assert_eq!(other.read(&mut world.radio, "2a00"), b"Plantar R");
    assert_stream_equals_replay(&mut world.radio, &mut [(&world.insole, &mut phone), (&right, &mut other)]);
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn a_signed_image_from_a_bonded_phone_is_swapped_in_after_the_restart() {
    let mut world = World::start(WALK(1));
    let mut phone = world.bonded_phone(247);
    let mut bytes = vec![0xff; 20 * CHUNK];
    let header = Header::new("emulated", "99.0.0").bytes();
    bytes[HEADER as usize..][..header.len()].copy_from_slice(&header);
    let image =
        Image::sign(bytes, &development_key().expect("the development key is valid")).expect("the image has a header");
    let mut request = Request::Begin(image.offer());
    loop {
        request = match phone.answer(&mut world.radio, ToDevice::Update(request)) {
            ToHost::Update(Progress::Next(number)) if number < image.offer().chunks => {
                Request::Chunk { number, chunk: image.chunk(number) }
            }
            ToHost::Update(Progress::Next(_)) => Request::Finish,
            other => break assert_eq!(other, ToHost::Update(Progress::Accepted)),
        }
    }
    assert!(world.insole.board.wait().expect("the board runs"), "the bootloader must swap the images");
}
