//! How long a central may occupy the insole, which serves one central at a time, without an encrypted link.

use embassy_time::{Duration, Instant};

/// Time for a central to encrypt the link, or to pair.
const ENCRYPTION: Duration = Duration::from_secs(30);
/// The same for an unknown central, after another one did not encrypt its link. It is short, so that the owner's phone soon gets
/// its turn.
const SUSPECTED: Duration = Duration::from_secs(2);
/// Time for which unknown centrals are suspected.
const SUSPICION: Duration = Duration::from_secs(300);

/// Limits the connections of strangers.
#[derive(Default)]
pub struct Admission {
    /// Unknown centrals are suspected until then.
    suspicious_until: Option<Instant>,
}

impl Admission {
    /// No stranger so far.
    pub const fn new() -> Self {
        Self { suspicious_until: None }
    }

    /// Time after its connection in which a central must have an encrypted link with a bond. `is_known` states that the central
    /// has a bond, `allows_bonding` that it may make one now.
    pub fn time_limit(&self, is_known: bool, allows_bonding: bool) -> Duration {
        let is_suspected = self.suspicious_until.is_some_and(|until| Instant::now() < until);
        if is_suspected && !is_known && !allows_bonding { SUSPECTED } else { ENCRYPTION }
    }

    /// Notes that a central was disconnected because it exceeded its limit.
    pub fn expelled(&mut self) {
        self.suspicious_until = Some(Instant::now() + SUSPICION);
    }
}
