//! Events of all kinds in any order: whatever happens to an insole and its links, no step that arrived is lost or delivered twice,
//! numbers increase, and counters add up.

use proptest::prelude::*;
use proptest_state_machine::{ReferenceStateMachine, StateMachineTest, prop_state_machine};
use std::cell::RefCell;
use std::rc::Rc;
use testkit::host::{Host, Over};
use testkit::scenario::{Outcome, follow};
use testkit::virtual_time::now_us;
use testkit::world::{Physical, SharedWorld, World};

/// Longest duration of a step with its swing, ms.
const STEP_MS: u64 = 1_200;
/// Time after a crash until the next start counts as successful, with the time in which it is detected, ms.
const HEALTHY_MS: u64 = 8_000;

/// An event, and the time after it, ms.
#[derive(Clone, Debug)]
struct Transition {
    event: Happening,
    then_ms: u64,
}

#[derive(Clone, Debug)]
enum Happening {
    Physical(Physical),
    Connect(Over),
    Disconnect,
    SetParameters,
    Restart,
    Nothing,
}

/// What is known before the events happen.
#[derive(Clone, Debug, Default)]
struct Known {
    now_ms: u64,
    walks_until_ms: u64,
    /// Crashes before this time could make failed starts in a row, after which stored data are not used.
    crashes_from_ms: u64,
}

struct AnyOrder;

fn events() -> impl Strategy<Value = Happening> {
    let physical = prop_oneof![
        6 => (1u32..12).prop_map(|steps| Physical::Walk { steps }),
        2 => (50_000u64..2_000_000).prop_map(|off_us| Physical::PowerCut { off_us }),
        2 => (0u64..30).prop_map(|operations| Physical::PowerCutInWrite { operations }),
        2 => (100_000u64..5_000_000).prop_map(|for_us| Physical::CableCut { for_us }),
        1 => prop_oneof![Just(0.0), Just(3_000.0), Just(900.0)].prop_map(|bytes_per_s| Physical::CableRate { bytes_per_s }),
        1 => prop_oneof![Just(0u32), 1_500u32..9_000].prop_map(|every_bytes| Physical::Damage { every_bytes }),
        2 => Just(Physical::RadioLost),
        1 => (1u32..40, 0usize..16).prop_map(|(frames, from_row)| Physical::MissFrames { frames, from_row }),
        1 => prop_oneof![Just("scan"), Just("model"), Just("link")].prop_map(Physical::Stall),
        1 => Just(Physical::Panic),
    ];
    prop_oneof![
        12 => physical.prop_map(Happening::Physical),
        3 => prop_oneof![Just(Over::Serial), Just(Over::Bluetooth)].prop_map(Happening::Connect),
        1 => Just(Happening::Disconnect),
        1 => Just(Happening::SetParameters),
        1 => Just(Happening::Restart),
        2 => Just(Happening::Nothing),
    ]
}

impl ReferenceStateMachine for AnyOrder {
    type State = Known;
    type Transition = Transition;

    fn init_state() -> BoxedStrategy<Known> {
        Just(Known::default()).boxed()
    }

    fn transitions(_: &Known) -> BoxedStrategy<Transition> {
        (events(), 10u64..4_000).prop_map(|(event, then_ms)| Transition { event, then_ms }).boxed()
    }

    fn preconditions(state: &Known, transition: &Transition) -> bool {
        match transition.event {
            // One walk at a time.
            Happening::Physical(Physical::Walk { .. }) => state.now_ms >= state.walks_until_ms,
            Happening::Physical(Physical::Stall(_) | Physical::Panic) => state.now_ms >= state.crashes_from_ms,
            _ => true,
        }
    }

    fn apply(mut state: Known, transition: &Transition) -> Known {
        match transition.event {
            Happening::Physical(Physical::Walk { steps }) => {
                state.walks_until_ms = state.now_ms + u64::from(steps) * STEP_MS;
            }
            Happening::Physical(Physical::Stall(_) | Physical::Panic) => {
                state.crashes_from_ms = state.now_ms + HEALTHY_MS;
            }
            _ => {}
        }
        state.now_ms += transition.then_ms;
        state
    }
}

struct Simulated {
    world: SharedWorld,
    hosts: Vec<Host>,
}

impl StateMachineTest for AnyOrder {
    type SystemUnderTest = Simulated;
    type Reference = Self;

    fn init_test(_: &Known) -> Simulated {
        let world = Rc::new(RefCell::new(World::new(1, 100.0)));
        let mut hosts = vec![Host::new(&world, 0)];
        // The host knows the insole: the very first step of a host that is lost on the way cannot be missed.
        hosts[0].connect(Over::Serial, true);
        world.borrow_mut().schedule(now_us() + 500_000, 0, Physical::Walk { steps: 1 });
        follow(&mut hosts, now_us() + 3_000_000);
        assert_eq!(hosts[0].steps.len(), 1);
        Simulated { world, hosts }
    }

    fn apply(mut simulated: Simulated, _: &Known, Transition { event, then_ms }: Transition) -> Simulated {
        let Simulated { world, hosts } = &mut simulated;
        let host = &mut hosts[0];
        match event {
            Happening::Physical(event) => world.borrow_mut().schedule(now_us(), 0, event),
            Happening::Connect(over) => host.connect(over, true),
            Happening::Disconnect => host.disconnect(),
            Happening::SetParameters => host.set_parameters(),
            Happening::Restart => host.restart(),
            Happening::Nothing => {}
        }
        follow(hosts, now_us() + then_ms * 1_000);
        simulated
    }

    fn check_invariants(simulated: &Simulated, _: &Known) {
        for pair in simulated.hosts[0].steps.windows(2) {
            assert!(plantar::sequence::is_after(pair[1].step, pair[0].step), "numbers increase");
        }
    }

    /// In the end the links work, and everything arrives.
    fn teardown(simulated: Simulated, _: Known) {
        let Simulated { world, mut hosts } = simulated;
        let calm = [Physical::CableRate { bytes_per_s: 0.0 }, Physical::Damage { every_bytes: 0 }];
        calm.into_iter().for_each(|event| world.borrow_mut().schedule(now_us(), 0, event));
        follow(&mut hosts, now_us() + 15_000_000);
        hosts[0].connect(Over::Serial, false);
        follow(&mut hosts, now_us() + 15_000_000);
        if let Err(error) = Outcome::new(&world, hosts).verify() {
            panic!("{error}");
        }
    }
}

prop_state_machine! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_is_lost_whatever_happens(sequential 1..40 => AnyOrder);
}
