//! The supervision of the firmware's parts.

use plantar::firmware::supervise::{Heartbeats, MOST_CHECKS, PARTS, Part, START_CHECKS, Watchdog};

/// The parts, in the order of [`PARTS`].
pub const ALL: [Part; PARTS.len()] = [Part::Scan, Part::Process, Part::Link, Part::Storage, Part::Radio];

/// The watchdog reports nothing until a part has had no heartbeat in as many successive checks as [`MOST_CHECKS`] states for it.
/// It then reports every part that has had none in at least its own number of checks minus two. Checks are counted from that of
/// the link's first heartbeat on, or from the [`START_CHECKS`]th check on if that is earlier; those of the radio not before its
/// own first heartbeat.
///
/// `has_heartbeat` states whether a part has a heartbeat before a check; the checks are numbered from 0. Before each check, a
/// frame is queued for processing. The queued frames wait until [`Part::Process`] has a heartbeat.
pub fn watchdog(checks: u32, has_heartbeat: impl Fn(Part, u32) -> bool) {
    let (heartbeats, mut watchdog) = (Heartbeats::new(), Watchdog::new());
    let mut silent_checks = [0; PARTS.len()];
    let (mut has_started, mut has_radio, mut pending) = (false, false, 0);
    for check in 0..checks {
        heartbeats.frame_queued();
        pending += 1;
        for part in ALL {
            if has_heartbeat(part, check) {
                if part == Part::Process {
                    (0..pending).for_each(|_| heartbeats.frame_processed());
                    pending = 0;
                } else {
                    heartbeats.progressed(part);
                }
            }
        }
        has_started |= has_heartbeat(Part::Link, check) || check + 1 >= START_CHECKS;
        has_radio |= has_heartbeat(Part::Radio, check);
        for part in ALL.into_iter().filter(|_| has_started) {
            let is_silent = !has_heartbeat(part, check) && (part != Part::Radio || has_radio);
            let silent = &mut silent_checks[part as usize];
            *silent = if is_silent { *silent + 1 } else { 0 };
        }
        let bits = |least: fn(u16) -> u16| {
            ALL.into_iter()
                .filter(|&part| silent_checks[part as usize] >= least(MOST_CHECKS[part as usize]))
                .fold(0, |bits, part| bits | 1 << part as u32)
        };
        let expected = if bits(|most| most) == 0 { 0 } else { bits(|most| most - 2) };
        assert_eq!(watchdog.check(&heartbeats), expected, "check {check}");
        assert_eq!(heartbeats.pending_frames(), pending);
        assert_eq!(watchdog.checks(), check + 1);
    }
}
