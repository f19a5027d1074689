//! The file of a recorded stream: its entries contain every byte up to the end of the file or up to the first damaged entry. No
//! more steps are evaluated from its messages, as usable or excluded, than it has step records.

use client::{Entries, Entry, STREAM_INSOLES};
use fit::live::LiveSteps;
use plantar::protocol::{ToHost, decode};

/// Checks one input.
pub fn check(data: &[u8]) {
    let mut insoles: [LiveSteps; STREAM_INSOLES] = Default::default();
    let mut records = 0;
    let (mut entries, mut rewritten) = (Entries::new(data), Vec::new());
    for Entry { t_ms, insole, message } in entries.by_ref().map_while(Result::ok) {
        rewritten.extend(t_ms.to_le_bytes());
        rewritten.push(insole as u8);
        rewritten.extend((message.len() as u16).to_le_bytes());
        rewritten.extend(message);
        match decode::<ToHost>(message) {
            Some(ToHost::Hello(_)) => insoles[insole].session_started(),
            Some(ToHost::Live(live)) => insoles[insole].frame(&live),
            Some(ToHost::Step(step)) => {
                records += 1;
                insoles[insole].step(&step);
            }
            _ => (),
        }
    }
    assert_eq!([&rewritten, entries.rest()].concat(), data);
    let mut evaluated = 0;
    for insole in &mut insoles {
        insole.finish();
        let (steps, excluded) = insole.collected(0);
        evaluated += steps.len() + excluded.len();
    }
    // A record that was received twice is evaluated once.
    assert!(evaluated <= records, "{evaluated} steps of {records} records");
}
