//! Walks in shoes that press on the insole even when the foot is lifted; and people who do not walk.

use plantar::pipeline::contact::ContactRule;
use recording::synthetic::SyntheticWalk;
use testkit::wear::{LEVELS_KPA, Residual, compare, noisy_walk};

/// The walk has the noise of a sensor. Each scenario has its own variation of the steps.
#[test]
fn steps_are_found_whatever_the_shoe_presses() {
    let (mut walked, mut found) = (0, 0);
    for contact in [ContactRule::COUNTED, ContactRule::COVERED] {
        for (seed, residual) in (1..).zip(Residual::ALL) {
            let walk = noisy_walk(&SyntheticWalk { steps: 60, variation: 0.1, seed, ..SyntheticWalk::default() });
            for level_kpa in LEVELS_KPA {
                let result = compare(&walk, contact, residual, level_kpa);
                println!("{residual:?} {level_kpa} kPa: {result:?}");
                assert_eq!((result.faults, result.extra), (0, 0), "{residual:?} {level_kpa} kPa");
                assert!(result.force_error < 0.02, "{residual:?} {level_kpa} kPa: {}", result.force_error);
                walked += result.walked;
                found += result.found;
            }
        }
    }
    println!("{found} of {walked} steps found");
    assert!(found as f64 >= 0.995 * walked as f64, "{found} of {walked}");
}
