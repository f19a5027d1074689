//! Two hosts that connect to one insole, one over the cable and one over the radio. The host that connected last has the
//! session; the other host waits until there is no session. Each step arrives at one of the hosts, once.

use client::{Client, Error};
use plantar::Side;
use plantar::pipeline::baseline::ZERO_S;
use plantar::protocol::{Refusal, Serial, ToDevice, ToHost};
use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;
use testkit::host::{Host, Link, LinkKind};
use testkit::virtual_time::now_us;
use testkit::walk::Posture;
use testkit::world::{InsoleEvent, World};

/// Two hosts of one insole, one over the cable and one over the radio. The wearer of the insole walks.
struct Hosts {
    cable: Host,
    radio: Host,
}

impl Hosts {
    fn new() -> Self {
        let world = Rc::new(RefCell::new(World::new(1, 100.0)));
        world.borrow_mut().schedule(1_000_000, 0, InsoleEvent::Walk { steps: 60 });
        let [cable, radio] = [(); 2].map(|()| Host::new(&world, 0));
        Self { cable, radio }
    }

    /// Lets both hosts run for this number of seconds; returns the number of live frames that each received.
    fn run(&mut self, seconds: u64) -> [u64; 2] {
        let before = [self.cable.live, self.radio.live];
        let end_us = now_us() + 1_000_000 * seconds;
        while now_us() < end_us {
            for host in [&mut self.cable, &mut self.radio] {
                // A host that has messages does not wait, so time advances once it has received all of them.
                let poll_us = now_us();
                while now_us() == poll_us {
                    host.poll();
                }
            }
        }
        [self.cable.live - before[0], self.radio.live - before[1]]
    }

    /// The numbers of all received steps, sorted.
    fn steps(&self) -> Vec<u32> {
        let mut steps: Vec<_> = self.cable.steps().chain(self.radio.steps()).map(|step| step.step).collect();
        steps.sort_unstable();
        steps
    }
}

/// A program on a computer follows the insole over the cable, and a page on a phone connects for a while.
#[test]
fn a_host_waits_while_another_one_uses_the_insole() {
    let mut hosts = Hosts::new();
    hosts.cable.connect(LinkKind::Serial, true);
    let [cable, _] = hosts.run(10);
    assert!(cable > 800, "{cable}");

    hosts.radio.connect(LinkKind::Bluetooth, true);
    hosts.run(1);
    let [cable, radio] = hosts.run(20);
    assert!(cable == 0 && radio > 1_800, "{cable} {radio}");
    assert_eq!(hosts.cable.hellos.len(), 1, "the waiting host does not take the session back");

    // The central disconnects, which the insole notices.
    hosts.radio.disconnect();
    hosts.run(4);
    let [cable, _] = hosts.run(10);
    assert!(cable > 900, "{cable}");
    assert_eq!(hosts.cable.hellos.len(), 2);

    let (cable_steps, radio_steps) = (hosts.cable.steps().count(), hosts.radio.steps().count());
    assert!(cable_steps > 15 && radio_steps > 10, "{cable_steps} {radio_steps}");
    let steps = hosts.steps();
    assert!(steps.iter().copied().eq(0..steps.len() as u32), "{steps:?}");
    assert!(hosts.cable.errors.is_empty(), "{:?}", hosts.cable.errors);
}

/// A program on a computer, which is connected over the cable, ends without sending a message.
#[test]
fn a_host_continues_after_the_other_one_was_silent_for_half_a_minute() {
    let mut hosts = Hosts::new();
    hosts.radio.connect(LinkKind::Bluetooth, true);
    hosts.run(5);
    hosts.cable.connect(LinkKind::Serial, false);
    hosts.run(1);
    hosts.cable.is_following = false;
    let [_, radio] = hosts.run(28);
    assert_eq!((radio, hosts.radio.hellos.len()), (0, 1));
    hosts.run(6);
    let [_, radio] = hosts.run(10);
    assert!(radio > 900, "{radio}");
    assert_eq!(hosts.radio.hellos.len(), 2);
    let steps = hosts.steps();
    assert!(steps.iter().copied().eq(0..steps.len() as u32), "{steps:?}");
}

/// The new host would take the answer to a request of the former one for the answer to a request of its own.
#[test]
fn the_answer_to_a_request_of_the_former_host_is_not_sent_to_the_new_one() {
    let serial = Serial::new("A-1").expect("the serial number is valid");
    // The new host connects before, while or after the insole executes the request.
    for delay_us in (0..20_000).step_by(500) {
        let world = Rc::new(RefCell::new(World::new(1, 100.0)));
        world.borrow_mut().run_for(1_000_000);
        let connect = |over| {
            let link = Link::open(&world, 0, over).expect("the insole is on");
            Client::connect(link, Duration::from_secs(5)).expect("the insole answers")
        };
        let mut cable = connect(LinkKind::Serial);
        cable.send(ToDevice::SetIdentity { side: Side::Left, serial }).expect("the cable is there");
        world.borrow_mut().run_for(delay_us);
        let mut radio = connect(LinkKind::Bluetooth);
        let end_us = now_us() + 1_000_000;
        while now_us() < end_us {
            let message = radio.receive().expect("the radio link is there");
            assert!(!matches!(message, Some(ToHost::Identity(_))), "{delay_us} us: {message:?}");
        }
        assert_eq!(radio.identity().expect("an answer").serial, serial, "{delay_us} us");
    }
}

/// The result of a measurement that an earlier host requested and has not waited for is no answer to a later request.
#[test]
fn a_request_to_measure_the_baselines_is_answered_by_its_own_measurement() {
    const SECOND_US: u64 = 1_000_000;
    let world = Rc::new(RefCell::new(World::new(1, 100.0)));
    let connect = || {
        let link = Link::open(&world, 0, LinkKind::Serial).expect("the cable is there");
        Client::connect(link, Duration::from_secs(5)).expect("the insole answers")
    };
    let stands = InsoleEvent::Rest { posture: Posture::Stand, for_us: 600 * SECOND_US };
    world.borrow_mut().schedule(3 * SECOND_US, 0, stands);
    world.borrow_mut().run_for(5 * SECOND_US);
    // The insole begins to measure within a second after the first request, and gives up `ZERO_S` seconds later, because the
    // wearer stands. The second request comes shortly before or after this moment.
    for tenths in 0..15 {
        connect().send(ToDevice::Zero).expect("the cable is there");
        world.borrow_mut().run_for(u64::from(ZERO_S) * SECOND_US - SECOND_US / 5 + tenths * SECOND_US / 10);
        let mut client = connect();
        let requested_us = now_us();
        assert!(matches!(client.zero(), Err(Error::Refused(Refusal::NotLifted))));
        let waited_us = now_us() - requested_us;
        assert!(waited_us >= u64::from(ZERO_S) * SECOND_US, "{tenths}: {waited_us}");
    }
}
