//! A long walk with both feet: the firmware's loops on a host in virtual time.

use plantar::pipeline::bout::BoutKind;
use testkit::scenario::LongWalk;
use testkit::walk::Posture;

#[test]
fn both_feet_deliver_every_step_of_a_long_walk() {
    let walk = LongWalk { rounds: 1, steps: 400, rests: &[], rate_hz: 100.0 };
    let start = std::time::Instant::now();
    let (outcome, walked) = walk.run(|_| ());
    let elapsed = start.elapsed();
    println!("{walked:?} walked in {elapsed:?}, {:.0} times real time", walked.as_secs_f64() / elapsed.as_secs_f64());
    // The result is the number of lost steps and load bouts of each foot.
    assert_eq!(outcome.verify(), Ok(vec![0, 0]));
    for insole in &outcome.insoles {
        assert_eq!((insole.host.steps().count(), insole.resets.len()), (400, 1));
    }
}

/// Eight hours in which the wearer walks, stands, sits and shuffles.
#[test]
fn both_feet_deliver_every_step_and_load_bout_of_a_day() {
    const RESTS: &[(Posture, u64)] = &[(Posture::Stand, 600), (Posture::Sit, 2_500), (Posture::Shuffle, 60)];
    let day = LongWalk { rounds: 8, steps: 400, rests: RESTS, rate_hz: 50.0 };
    let (outcome, duration) = day.run(|_| ());
    assert!(duration.as_secs() >= 8 * 3_500, "{duration:?}");
    assert_eq!(outcome.verify(), Ok(vec![0, 0]));
    for insole in &outcome.insoles {
        assert_eq!((insole.host.steps().count(), insole.resets.len()), (8 * 400, 1));
        let minutes = |kind: BoutKind| {
            let bouts = insole.host.bouts().filter(|bout| bout.kind == kind);
            bouts.map(|bout| u64::from(bout.duration_us)).sum::<u64>() as f64 / 60e6
        };
        // A bout ends up to two windows of two seconds earlier or later than the wearer's activity.
        for (kind, expected) in
            [(BoutKind::Standing, 80.0), (BoutKind::Sitting, 8.0 * 2_500.0 / 60.0), (BoutKind::Shuffling, 8.0)]
        {
            assert!((minutes(kind) - expected).abs() < 8.0 * 4.0 / 60.0 + 0.01, "{kind:?}: {} min", minutes(kind));
        }
    }
}
