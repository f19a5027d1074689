//! Random events in any order: no stored step is lost or delivered twice, step numbers increase, and counters are consistent.

use plantar::firmware::supervise::{CHECK_PERIOD_MS, MOST_CHECKS, Part, START_CHECKS};
use proptest::prelude::*;
use proptest_state_machine::{ReferenceStateMachine, StateMachineTest, prop_state_machine};
use std::cell::RefCell;
use std::rc::Rc;
use testkit::host::{Host, LinkKind};
use testkit::scenario::{Outcome, follow};
use testkit::virtual_time::now_us;
use testkit::world::{InsoleEvent, SharedWorld, World};

/// Longest duration of a step with its swing, ms.
const STEP_MS: u64 = 1_200;
/// Largest number of crashes. After one more, the insole could start in recovery mode, without its stored data.
const MOST_CRASHES: u32 = 2;

/// An event, and the time until the next one.
#[derive(Clone, Debug)]
struct Transition {
    event: Event,
    until_next_ms: u64,
}

#[derive(Clone, Debug)]
enum Event {
    Insole(InsoleEvent),
    Connect(LinkKind),
    Disconnect,
    SetParameters,
    Restart,
    Nothing,
}

/// The state that restricts which event can be next.
#[derive(Clone, Debug, Default)]
struct Schedule {
    now_ms: u64,
    /// Time by which the last stance of the present walk has ended, ms.
    walks_until_ms: u64,
    /// Number of crashes so far.
    crashes: u32,
    /// Largest number of restarts that the events so far can cause.
    restarts: usize,
    /// The link's task has stalled.
    has_link_stall: bool,
    /// The radio's task has stalled.
    has_radio_stall: bool,
}

/// The state machine of the test.
struct AnyOrder;

fn events() -> impl Strategy<Value = Event> {
    let insole_events = prop_oneof![
        6 => (1u32..12).prop_map(|steps| InsoleEvent::Walk { steps }),
        2 => (50_000u64..2_000_000).prop_map(|off_us| InsoleEvent::PowerCut { off_us }),
        2 => (0u64..30).prop_map(|operations| InsoleEvent::PowerCutInWrite { operations }),
        2 => (100_000u64..5_000_000).prop_map(|for_us| InsoleEvent::CableCut { for_us }),
        1 => prop_oneof![Just(0.0), Just(3_000.0), Just(900.0)]
            .prop_map(|bytes_per_s| InsoleEvent::CableRate { bytes_per_s }),
        1 => prop_oneof![Just(0u32), 1_500u32..9_000].prop_map(|every_bytes| InsoleEvent::Damage { every_bytes }),
        2 => Just(InsoleEvent::RadioLost),
        1 => (1u32..40, 0usize..16).prop_map(|(frames, from_row)| InsoleEvent::MissFrames { frames, from_row }),
        1 => prop_oneof![Just("scan"), Just("process"), Just("link"), Just("radio")].prop_map(InsoleEvent::Stall),
        1 => Just(InsoleEvent::Panic),
    ];
    prop_oneof![
        12 => insole_events.prop_map(Event::Insole),
        3 => prop_oneof![Just(LinkKind::Serial), Just(LinkKind::Bluetooth)].prop_map(Event::Connect),
        1 => Just(Event::Disconnect),
        1 => Just(Event::SetParameters),
        1 => Just(Event::Restart),
        2 => Just(Event::Nothing),
    ]
}

impl ReferenceStateMachine for AnyOrder {
    type State = Schedule;
    type Transition = Transition;

    fn init_state() -> BoxedStrategy<Schedule> {
        Just(Schedule::default()).boxed()
    }

    fn transitions(_: &Schedule) -> BoxedStrategy<Transition> {
        (events(), 10u64..4_000).prop_map(|(event, until_next_ms)| Transition { event, until_next_ms }).boxed()
    }

    fn preconditions(state: &Schedule, transition: &Transition) -> bool {
        match transition.event {
            // A walk begins after the last stance of the previous one.
            Event::Insole(InsoleEvent::Walk { .. }) => state.now_ms >= state.walks_until_ms,
            Event::Insole(InsoleEvent::Stall(_) | InsoleEvent::Panic) => state.crashes < MOST_CRASHES,
            _ => true,
        }
    }

    fn apply(mut state: Schedule, transition: &Transition) -> Schedule {
        state.restarts += usize::from(matches!(
            transition.event,
            Event::Restart
                | Event::Insole(
                    InsoleEvent::PowerCut { .. }
                        | InsoleEvent::PowerCutInWrite { .. }
                        | InsoleEvent::Stall(_)
                        | InsoleEvent::Panic
                )
        ));
        match transition.event {
            Event::Insole(InsoleEvent::Walk { steps }) => {
                state.walks_until_ms = state.now_ms + u64::from(steps) * STEP_MS;
            }
            Event::Insole(InsoleEvent::Stall(part)) => {
                state.crashes += 1;
                state.has_link_stall |= part == "link";
                state.has_radio_stall |= part == "radio";
            }
            Event::Insole(InsoleEvent::Panic) => state.crashes += 1,
            _ => {}
        }
        state.now_ms += transition.until_next_ms;
        state
    }
}

/// The simulated insole, and its host.
struct Simulated {
    world: SharedWorld,
    hosts: Vec<Host>,
}

/// Lets time pass in which the supervision makes this number of checks.
fn follow_checks(hosts: &mut [Host], checks: u32) {
    follow(hosts, now_us() + u64::from(checks * CHECK_PERIOD_MS) * 1_000);
}

impl StateMachineTest for AnyOrder {
    type SystemUnderTest = Simulated;
    type Reference = Self;

    fn init_test(_: &Schedule) -> Simulated {
        let world = Rc::new(RefCell::new(World::new(1, 100.0)));
        let mut hosts = vec![Host::new(&world, 0)];
        // The host receives one step before the events, because it could not detect the loss of an insole's very first step.
        hosts[0].connect(LinkKind::Serial, true);
        world.borrow_mut().schedule(now_us() + 500_000, 0, InsoleEvent::Walk { steps: 1 });
        follow(&mut hosts, now_us() + 3_000_000);
        assert_eq!(hosts[0].steps().count(), 1);
        Simulated { world, hosts }
    }

    fn apply(mut simulated: Simulated, _: &Schedule, Transition { event, until_next_ms }: Transition) -> Simulated {
        let Simulated { world, hosts } = &mut simulated;
        let host = &mut hosts[0];
        match event {
            Event::Insole(event) => world.borrow_mut().schedule(now_us(), 0, event),
            Event::Connect(over) => host.connect(over, true),
            Event::Disconnect => host.disconnect(),
            Event::SetParameters => host.set_parameters(),
            Event::Restart => host.restart(),
            Event::Nothing => {}
        }
        follow(hosts, now_us() + until_next_ms * 1_000);
        simulated
    }

    fn check_invariants(simulated: &Simulated, _: &Schedule) {
        for pair in simulated.hosts[0].records.windows(2) {
            assert!(plantar::sequence::is_after(pair[1].number(), pair[0].number()), "numbers must increase");
        }
    }

    /// Repairs the link at the end. Every step must then arrive, except the last ones before a crash or a loss of power.
    fn teardown(simulated: Simulated, schedule: Schedule) {
        let Simulated { world, mut hosts } = simulated;
        let repairs = [InsoleEvent::CableRate { bytes_per_s: 0.0 }, InsoleEvent::Damage { every_bytes: 0 }];
        repairs.into_iter().for_each(|event| world.borrow_mut().schedule(now_us(), 0, event));
        if schedule.has_radio_stall {
            // A stalled radio restarts the insole only after this time, and the restart must not fall into the next session.
            follow_checks(&mut hosts, MOST_CHECKS[Part::Radio as usize].into());
        }
        follow(&mut hosts, now_us() + 15_000_000);
        hosts[0].connect(LinkKind::Serial, false);
        follow(&mut hosts, now_us() + 15_000_000);
        if schedule.has_link_stall && hosts[0].status().is_none() {
            // A stall of this task before its first heartbeat is detected only after this time.
            follow_checks(&mut hosts, START_CHECKS);
        }
        assert!(hosts[0].status().is_some(), "the insole must answer at the end");
        let outcome = Outcome::new(&world, hosts);
        if let Err(error) = outcome.verify() {
            panic!("{error}");
        }
        let resets = &outcome.insoles[0].resets;
        assert!(resets.len() <= 1 + schedule.restarts, "{} events restart the insole: {resets:?}", schedule.restarts);
    }
}

prop_state_machine! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_sequence_of_events_violates_an_invariant(sequential 1..40 => AnyOrder);
}
