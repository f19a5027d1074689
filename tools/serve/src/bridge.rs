//! The session with one insole: passes its messages to the hub, and acknowledges records that a page or the recording has stored.

use crate::hub::Hub;
use crate::report;
use client::{Carrier, Error, Event, Link, Open, ReconnectPolicy};
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{LoadRecord, ToDevice, ToHost};
use std::time::{Duration, Instant};

/// Time between two requests for the insole's counters and its load of the day.
const STATUS_INTERVAL: Duration = Duration::from_secs(1);

/// A session with an insole, over any carrier.
pub(crate) type Session = Link<Box<dyn Carrier + Send>>;

/// How to connect to an insole.
pub struct Source {
    /// Its name, as the user gave it.
    pub name: String,
    /// Opens the carrier. Called again after the carrier failed.
    pub open: Open<Box<dyn Carrier + Send>>,
    /// The wearer's parameters. The insole receives them at the beginning of the first session only, so that parameters that a
    /// page sends later remain in force after a reconnection.
    pub tissue: Option<Tissue>,
}

impl Source {
    /// Opens a session with a live stream.
    pub(crate) fn connect(self) -> Result<Session, Error> {
        let mut insole = Link::connect(self.open, ReconnectPolicy::STREAM)?;
        if let Some(tissue) = &self.tissue {
            insole.client().set_tissue(tissue)?;
        }
        insole.start()?;
        Ok(insole)
    }
}

/// Bridges the insole with this index to the hub until the program ends. Reconnects after a lost link. Returns earlier if
/// reconnecting fails with an error that is no failure of the link, such as another protocol version. Printed errors begin with
/// `name`.
pub(crate) fn run(hub: &Hub, index: usize, name: &str, mut insole: Session) {
    pass_hello(hub, index, &mut insole);
    let mut status_requested_at = Instant::now();
    loop {
        let event = insole.next_event();
        if let Ok(Event::Message(message)) = &event {
            hub.publish(index, message, insole.client().clock_mapping());
        }
        match event {
            Ok(Event::Started(_)) => pass_hello(hub, index, &mut insole),
            Ok(Event::Message(ToHost::Live(live))) => hub.live(index, live),
            Ok(Event::Message(ToHost::Ellipses(ellipses))) => hub.ellipses(index, ellipses),
            Ok(Event::Message(message)) if let Some(record) = LoadRecord::of(&message) => {
                hub.load_record(index, record)
            }
            Ok(Event::Message(ToHost::Status(status))) => hub.status(index, status),
            Ok(Event::Message(ToHost::AlertRules(rules))) => hub.alert_rules(index, rules),
            Ok(Event::Message(ToHost::DailyLoad(daily))) => hub.daily_load(index, daily),
            Ok(Event::Message(ToHost::Tissue(tissue))) => hub.tissue_answer(index, Ok(tissue)),
            Ok(Event::Message(ToHost::Identified(identified))) => hub.identified(index, identified),
            Ok(Event::Message(ToHost::Refused(refusal))) => hub.tissue_answer(index, Err(refusal)),
            // The hello of a repeated connect request, or the answer to a request that this loop does not send.
            Ok(Event::Message(_) | Event::Timeout) => {}
            Ok(Event::Lost(error)) => {
                hub.lost(index);
                if hub.has_ended() {
                    return;
                }
                report(format_args!("{name}: {error}; trying again"));
            }
            Err(error) => {
                report(format_args!("{name}: {error}"));
                return;
            }
        }
        hub.clock_mapping(index, insole.client().clock_mapping());
        if let Some(number) = hub.acknowledgement(index) {
            insole.send(ToDevice::Acknowledge { number });
        }
        if let Some(request) = hub.to_send(index) {
            insole.send(request);
        }
        if let Some(request) = hub.ellipses_to_request(index) {
            insole.send(request);
        }
        if status_requested_at.elapsed() > STATUS_INTERVAL {
            status_requested_at = Instant::now();
            hub.record_time(index);
            insole.send(ToDevice::GetStatus);
            insole.send(ToDevice::GetDailyLoad);
        }
    }
}

/// Passes the hello, the counters, the parameters, the rules of alerts and the layout of a new session to the hub.
fn pass_hello(hub: &Hub, index: usize, insole: &mut Session) {
    let client = insole.client();
    // The hub acknowledges a record only if it has arrived in this session.
    client.forget_unacknowledged();
    // The values are unknown if the insole does not answer in time.
    let (status, tissue, alert_rules) = (client.status().ok(), client.tissue().ok(), client.alert_rules().ok());
    let layout = hub.layout(index, client.hello().layout_id).or_else(|| {
        let (setup, cells) = (client.setup().ok()?, client.setup_cells().ok()?);
        Some((setup, &*cells.leak()))
    });
    hub.hello(index, client.hello(), status, tissue, alert_rules, layout);
}
