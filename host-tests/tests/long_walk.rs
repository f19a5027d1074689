//! A long walk with both feet: the firmware's tasks on a host in virtual time.

use testkit::scenario::LongWalk;

#[test]
fn both_feet_deliver_every_step_of_a_long_walk() {
    let walk = LongWalk { steps: 400, rate_hz: 100.0 };
    let start = std::time::Instant::now();
    let (outcome, walked) = walk.run(|_| ());
    println!("{:?} walked in {:?}: {}", walked, start.elapsed(), walked.as_secs_f64() / start.elapsed().as_secs_f64());
    assert_eq!(outcome.verify(), Ok(0));
    for insole in &outcome.insoles {
        assert_eq!(insole.host.steps().count(), 400);
    }
}
