//! CSV in long form, for R and pandas: one row for each time, quantity and region.

use crate::{EventKind, Session};
use recording::{Result, output};
use std::io;
use std::path::Path;

/// The value of the column `region` for quantities of the whole foot.
const FOOT: &str = "foot";

/// Writes a CSV file with the columns `t_s`, `side`, `region`, `quantity` and `value`. The unit is part of the name of a
/// quantity. Heel strikes and toe offs are rows with the number of the step as value. Absent values have no row.
///
/// # Errors
/// Fails if the file cannot be written.
pub fn write(session: &Session, path: &Path) -> Result<()> {
    output::file(path, |to| {
        let mut to = ::csv::Writer::from_writer(to);
        let mut row = |fields: [&str; 5]| to.write_record(fields).map_err(io::Error::other);
        row(["t_s", "side", "region", "quantity", "value"])?;
        let channels = session.channels();
        let events = session.events();
        let mut events = events.iter().peekable();
        for (i, t_s) in session.t_s.iter().enumerate() {
            while let Some(event) = events.next_if(|event| event.t_s <= *t_s) {
                let (t_s, step) = (event.t_s.to_string(), event.step.to_string());
                row([&t_s, event.side.name(), FOOT, EventKind::name(event.kind), &step])?;
            }
            let t_s = t_s.to_string();
            for channel in &channels {
                let Some(value) = channel.value(i) else { continue };
                let region = channel.quantity.region().map_or(FOOT, |region| region.name());
                // Single precision, in which the insole computes.
                row([&t_s, channel.side().name(), region, channel.quantity.name(), &(value as f32).to_string()])?;
            }
        }
        to.flush()
    })
}
