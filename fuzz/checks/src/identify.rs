//! The messages of an insole in a guided session on the web page (`tools/phone`): any messages result in steps that are counted,
//! and in a fit or the reason why there is none.

use crate::Pieces;
use parameters::InsoleSize;
use phone_identify::Session;

/// Largest number of steps that are fitted: few enough for many executions per second.
const FITTED_STEPS: u64 = 2;

/// Checks one input.
pub fn check(data: &[u8]) {
    let mut session = Session::default();
    for message in Pieces(data) {
        session.add(0, message);
    }
    let good = session.collected()[0]["good"].as_u64().expect("a number of steps");
    if good <= FITTED_STEPS {
        let result = session.identify(0, InsoleSize::default(), &|_| ());
        assert!(result["error"].is_string() || result["regions"].is_object());
    }
}
