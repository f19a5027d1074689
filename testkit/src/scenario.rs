//! Scenarios: events that happen to simulated insoles and their hosts, and the expected outcome, as data.
//!
//! A scenario is a TOML file with a title, a list of events with their times, and the expected outcome; `host-tests/scenarios`
//! has an example of every event. The invariants of [`Outcome::verify`] must hold after any events.

use crate::board::MAX_VALUE;
use crate::host::{Host, LinkKind};
use crate::insole::{Defect, INITIAL_VERSION, image};
use crate::virtual_time::now_us;
use crate::walk::Posture;
use crate::world::{InsoleEvent, SharedWorld, World};
use emulator::SensorFault;
use parameters::{InsoleSize, Parameters};
use plantar::faults::Fault;
use plantar::firmware::shared::STORAGE_QUEUE;
use plantar::pipeline::alert::AlertRules;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::cumulative::LoadLimits;
use plantar::pipeline::setup::PERIOD_US;
use plantar::pipeline::tissue::{AreaFilter, Identified};
use plantar::protocol::update::{Progress, Request};
use plantar::protocol::{Alert, Bout, LoadRecord, Reset, Serial, Settings, Status, Step, StepRegion, ToDevice};
use plantar::sequence::is_after;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use std::cell::RefCell;
use std::io;
use std::num::NonZeroU32;
use std::rc::Rc;
use std::time::Duration;
use thiserror::Error;
use toml::Spanned;

/// Time after the end of a scenario within which all pending messages arrive, s.
const SETTLE_S: f64 = 4.0;

/// Why a scenario cannot run.
#[derive(Debug, Error)]
pub enum ScenarioError {
    /// The file is not a scenario: it has for example an unknown event, or lacks a value. The message contains line and column.
    #[error("{0}")]
    Syntax(#[from] toml::de::Error),
    /// An event is impossible after the previous ones, or has an invalid value.
    #[error("line {line}: {reason}")]
    Order {
        /// Line of the event, from 1.
        line: usize,
        /// Why the event is impossible, and the remedy.
        reason: String,
    },
}

/// A scenario.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// What happens and what is expected, in one sentence.
    pub title: String,
    /// Number of insoles: 1, or 2 for a pair.
    #[serde(default = "default_insoles", deserialize_with = "one_or_two")]
    pub insoles: usize,
    /// Number of frames per second.
    #[serde(default = "default_rate_hz", deserialize_with = "possible_rate")]
    pub rate_hz: f64,
    /// Duration until the events have no further effect, s.
    pub duration_s: f64,
    /// The events, sorted by time.
    #[serde(default, rename = "at")]
    pub events: Vec<Spanned<Entry>>,
    /// The expected outcome.
    #[serde(default)]
    pub expect: Expect,
}

fn default_insoles() -> usize {
    1
}

fn default_rate_hz() -> f64 {
    100.0
}

fn one_or_two<'de, D: Deserializer<'de>>(deserializer: D) -> Result<usize, D::Error> {
    match usize::deserialize(deserializer)? {
        insoles @ 1..=2 => Ok(insoles),
        insoles => Err(D::Error::custom(format!("{insoles} insoles: use 1, or 2 for a pair"))),
    }
}

fn possible_rate<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let rate_hz = f64::deserialize(deserializer)?;
    let possible_hz = [PERIOD_US.end(), PERIOD_US.start()].map(|&period_us| 1e6 / f64::from(period_us));
    if !(possible_hz[0]..=possible_hz[1]).contains(&rate_hz) {
        let [least_hz, most_hz] = possible_hz;
        return Err(D::Error::custom(format!("{rate_hz} frames per second: use {least_hz} to {most_hz}")));
    }
    Ok(rate_hz)
}

/// An event and its time.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Time since the start of the scenario, s.
    pub s: f64,
    /// The insole that the event concerns: 0 for the left one, 1 for the right one.
    #[serde(default)]
    pub insole: usize,
    /// The event.
    pub event: Event,
}

/// An event. The events up to `panic` act on an insole or its links; the others are actions of the host.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Event {
    /// The wearer walks.
    Walk {
        /// Number of steps of this foot.
        steps: u32,
    },
    /// The wearer stands, shuffles or sits.
    Rest {
        /// What the wearer does.
        posture: Posture,
        /// Duration, s.
        for_s: f64,
    },
    /// Power is cut, and returns after `off_s`.
    PowerCut {
        /// Duration, s.
        off_s: f64,
    },
    /// Power fails within a write or erase operation of the flash chip, and returns after a second.
    PowerCutInWrite {
        /// Number of operations from now on that still succeed.
        operations: u64,
    },
    /// The cable is cut.
    CableCut {
        /// Duration, s.
        for_s: f64,
    },
    /// Limits the rate of the cable to the host from now on.
    CableRate {
        /// Bytes per second; 0 for no limit.
        bytes_per_s: f64,
    },
    /// Damages bytes in both directions at random intervals from now on.
    Damage {
        /// Mean number of bytes from one damaged byte to the next; 0 for no damage.
        every_bytes: u32,
    },
    /// The radio link is lost.
    RadioLost,
    /// The matrix answers only for its first rows, or not at all, for a number of frames.
    MissFrames {
        /// Number of incomplete frames.
        frames: u32,
        /// The first row for which the matrix does not answer.
        #[serde(default)]
        from_row: usize,
    },
    /// The sensor has a fault from now on, in the notation of `plantar emulate --fault`: for example `open-cell:17`.
    SensorFault(String),
    /// A part of the firmware stalls, as in an endless loop.
    Stall(Part),
    /// The flash chip does not answer from the next start on.
    ChipSilent,
    /// From the next start on, the firmware's first read of the bootloader's state fails in each start.
    StateReadFails,
    /// The supply is too low to change the flash chip.
    LowSupply {
        /// Duration, s.
        for_s: f64,
    },
    /// The flash chip does not return what the log of load records contains.
    LogUnreadable {
        /// Duration, s.
        for_s: f64,
    },
    /// The firmware panics.
    Panic,

    /// The host opens a session, and opens it again whenever the link is lost.
    Connect {
        /// The link.
        over: LinkName,
        /// True if the host requests live frames.
        #[serde(default)]
        live: bool,
    },
    /// The host ends its session, and does not connect again.
    Disconnect,
    /// Whether the host acknowledges the load records that it receives from now on.
    Acknowledge(bool),
    /// Limits the length of a value on the radio link, bytes: the ATT MTU minus 3.
    ValueLength(usize),
    /// The host sets the wearer's parameters: typical ones.
    SetParameters,
    /// The host sets typical parameters as if they were identified with a contact rule of this `full_kpa`.
    SetIdentified {
        /// [`plantar::pipeline::contact::ContactRule::full_kpa`].
        full_kpa: f32,
        /// [`Identified::regions`].
        #[serde(default = "default_regions")]
        regions: u8,
    },
    /// The host sets the insole's settings, with a contact rule of this `full_kpa`; without `full_kpa`, it removes the
    /// settings. The steps of later boots are compared with those that result from the settings.
    SetSettings {
        /// [`plantar::pipeline::contact::ContactRule::full_kpa`].
        full_kpa: Option<f32>,
        /// Frames per second.
        #[serde(default = "default_settings_rate_hz")]
        rate_hz: NonZeroU32,
        /// [`Settings::scale`].
        #[serde(default = "default_scale")]
        scale: f32,
    },
    /// The host sets rules of alerts, with the recommended limits of pressure.
    SetAlerts {
        /// [`LoadLimits::window_s`].
        window_s: u16,
        /// [`AlertRules::pause_s`].
        pause_s: u16,
        /// [`AlertRules::per_day`].
        per_day: u8,
        /// [`AlertRules::dose_kpa_s`].
        #[serde(default)]
        dose_kpa_s: f32,
    },
    /// The host requests that the baselines are measured.
    Zero,
    /// The host requests that no alerts are raised for this time, s.
    SnoozeAlerts(u16),
    /// The host sets the serial number.
    SetSerial(String),
    /// The host erases the data of the wearer.
    EraseWearer,
    /// The host restarts the insole.
    Restart,
    /// The host sends a firmware image.
    Update {
        /// The version of the image.
        version: String,
        /// The defect of the image.
        #[serde(default)]
        defect: Defect,
    },
    /// The host confirms the running image.
    ConfirmUpdate,
}

fn default_settings_rate_hz() -> NonZeroU32 {
    const { NonZeroU32::new(100).unwrap() }
}

/// The reset reasons of an insole that starts only once.
fn one_start() -> Vec<String> {
    vec![Reset::Power.name().to_owned()]
}

/// All regions.
fn default_regions() -> u8 {
    u8::MAX
}

fn default_scale() -> f32 {
    1.0
}

/// A part of the firmware that can stall.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Scans the matrix.
    Scan,
    /// Processes the frames.
    Process,
    /// Serves the serial link.
    Link,
    /// Bluetooth, with its radio.
    Radio,
}

/// The name of a link in a scenario.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LinkName {
    /// The cable.
    Serial,
    /// The radio.
    Bluetooth,
}

/// The expected outcome. Absent items are not checked.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// Number of steps that arrive from all insoles, each once.
    pub steps: Option<usize>,
    /// Kinds of the load bouts that arrive from the first insole.
    pub bouts: Option<Vec<String>>,
    /// Times of the alerts that arrive from the first insole, since the first scan of its boot, s.
    pub alerts: Option<Vec<f64>>,
    /// Largest number of computed steps and load bouts of the first insole that may not arrive: lost by a loss of power, a crash
    /// or a failure of the flash chip, or still on the insole at the end. Those of the other insole must all arrive.
    #[serde(default)]
    pub lost_at_most: usize,
    /// The reset reasons of all starts of the first insole; by default, it starts only once. The other insole must start only
    /// once.
    pub resets: Option<Vec<String>>,
    /// The sensor faults that the first insole reports, each as its kind and place.
    pub faults: Option<Vec<String>>,
    /// Number of sessions that the host of the first insole opened.
    pub sessions: Option<usize>,
    /// Whether the first insole sent a step, load bout or alert again that had arrived before.
    pub repeats_records: Option<bool>,
    /// Whether live frames of the first insole were lost.
    pub loses_live: Option<bool>,
    /// Number of frames of the first insole since its last start without a complete scan, because the scan was late or the matrix
    /// did not answer.
    pub frames_missed: Option<u32>,
    /// Number of frames of the first insole in all its boots, each from the first complete scan to the last, without a complete
    /// scan, whatever the cause.
    pub frames_without_scan: Option<u32>,
    /// Number of frames of the first insole that were not scanned since its last start, because it was not worn.
    pub frames_skipped: Option<u32>,
    /// Numbers of contacts of the first insole since its last start that were rejected as steps: too short, too long, interrupted
    /// by missing frames.
    pub rejected: Option<[u32; 3]>,
    /// Versions of the first insole's firmware, beginning with the first one, one for each change; `initial` stands for that of
    /// the image that runs at first, which is the version of this workspace.
    pub versions: Option<Vec<String>>,
    /// Serial number of the first insole at the end.
    pub serial: Option<String>,
    /// `full_kpa` of the contact rule of the first insole at the end.
    pub contact_full_kpa: Option<f32>,
    /// Frames per second of the first insole at the end.
    pub rate_hz: Option<u32>,
    /// Whether the first insole has parameters at the end.
    pub parameters: Option<bool>,
    /// Whether the last step of the first insole has a stiffness that was tracked since parameters were set.
    pub is_tracked: Option<bool>,
    /// A part of the text of one of the errors of the first insole's host.
    pub error: Option<String>,
    /// Number of requests of all hosts that are refused or not answered.
    #[serde(default)]
    pub failed_requests: usize,
    /// The beginning of the fault text in the last hello of the first insole: the crash that ended its previous boot or, without
    /// one, what failed at its start.
    pub last_fault: Option<String>,
}

impl Scenario {
    /// Reads a scenario.
    ///
    /// # Errors
    /// If the text is not a scenario, or an event is impossible; the message contains the line.
    pub fn parse(text: &str) -> Result<Self, ScenarioError> {
        let scenario: Self = toml::from_str(text)?;
        let mut checker = EventCheck::new(&scenario);
        for entry in &scenario.events {
            checker.check(entry.get_ref()).map_err(|reason| {
                let line = 1 + text[..entry.span().start].matches('\n').count();
                ScenarioError::Order { line, reason }
            })?;
        }
        Ok(scenario)
    }

    /// Runs the scenario.
    pub fn run(&self) -> Outcome {
        let start_us = now_us();
        let at_us = |s: f64| start_us + (s * 1e6) as u64;
        let world: SharedWorld = Rc::new(RefCell::new(World::new(self.insoles, self.rate_hz)));
        let mut hosts: Vec<_> = (0..self.insoles).map(|insole| Host::new(&world, insole)).collect();
        let mut actions = Vec::new();
        for entry in self.events.iter().map(Spanned::get_ref) {
            match insole_event(&entry.event) {
                Some(event) => world.borrow_mut().schedule(at_us(entry.s), entry.insole, event),
                None => actions.push(entry),
            }
        }
        for entry in actions {
            follow(&mut hosts, at_us(entry.s));
            act(&world, &mut hosts[entry.insole], entry.insole, &entry.event);
        }
        follow(&mut hosts, at_us(self.duration_s));
        follow(&mut hosts, at_us(self.duration_s + SETTLE_S));
        Outcome::new(&world, hosts)
    }
}

/// Lets the hosts receive until this time. The last wait of a host may end a little later.
pub fn follow(hosts: &mut [Host], until_us: u64) {
    while now_us() < until_us {
        hosts.iter_mut().for_each(Host::poll);
    }
}

/// The [`InsoleEvent`] of a scenario's event; `None` for an action of the host.
fn insole_event(event: &Event) -> Option<InsoleEvent> {
    let us = |s: f64| (s * 1e6) as u64;
    Some(match event {
        Event::Walk { steps } => InsoleEvent::Walk { steps: *steps },
        Event::Rest { posture, for_s } => InsoleEvent::Rest { posture: *posture, for_us: us(*for_s) },
        Event::PowerCut { off_s } => InsoleEvent::PowerCut { off_us: us(*off_s) },
        Event::PowerCutInWrite { operations } => InsoleEvent::PowerCutInWrite { operations: *operations },
        Event::CableCut { for_s } => InsoleEvent::CableCut { for_us: us(*for_s) },
        Event::CableRate { bytes_per_s } => InsoleEvent::CableRate { bytes_per_s: *bytes_per_s },
        Event::Damage { every_bytes } => InsoleEvent::Damage { every_bytes: *every_bytes },
        Event::RadioLost => InsoleEvent::RadioLost,
        Event::MissFrames { frames, from_row } => InsoleEvent::MissFrames { frames: *frames, from_row: *from_row },
        // `EventCheck` has verified that the fault can be parsed.
        Event::SensorFault(fault) => InsoleEvent::SensorFault(fault.parse().ok()?),
        Event::Stall(Part::Scan) => InsoleEvent::Stall("scan"),
        Event::Stall(Part::Process) => InsoleEvent::Stall("process"),
        Event::Stall(Part::Link) => InsoleEvent::Stall("link"),
        Event::Stall(Part::Radio) => InsoleEvent::Stall("radio"),
        Event::Panic => InsoleEvent::Panic,
        Event::ChipSilent => InsoleEvent::ChipSilent,
        Event::StateReadFails => InsoleEvent::StateReadFails,
        Event::LowSupply { for_s } => InsoleEvent::LowSupply { for_us: us(*for_s) },
        Event::LogUnreadable { for_s } => InsoleEvent::LogUnreadable { for_us: us(*for_s) },
        _ => return None,
    })
}

/// Executes an action of a host. An error is added to [`Host::errors`], and counted in [`Host::failed_requests`].
fn act(world: &SharedWorld, host: &mut Host, insole: usize, event: &Event) {
    let result = match event {
        Event::Connect { over, live } => {
            let over = match over {
                LinkName::Serial => LinkKind::Serial,
                LinkName::Bluetooth => LinkKind::Bluetooth,
            };
            host.connect(over, *live);
            Ok(())
        }
        Event::Disconnect => {
            host.disconnect();
            Ok(())
        }
        Event::Acknowledge(acknowledges) => {
            host.acknowledges = *acknowledges;
            Ok(())
        }
        Event::ValueLength(bytes) => {
            world.borrow().insoles[insole].radio.borrow_mut().max_value = *bytes;
            Ok(())
        }
        _ => request(world, host, insole, event),
    };
    if let Err(error) = result {
        host.errors.push(error.to_string());
        host.failed_requests += 1;
    }
}

/// Sends a host's request, and waits for the answer if there is one. Fails before the first connection.
fn request(world: &SharedWorld, host: &mut Host, insole: usize, event: &Event) -> Result<(), client::Error> {
    let Some(client) = &mut host.client else { return Err(io::Error::from(io::ErrorKind::NotConnected).into()) };
    match event {
        Event::SetParameters => client.set_tissue(&Parameters::typical(InsoleSize::default()).tissue()),
        Event::SetIdentified { full_kpa, regions } => {
            let contact = ContactRule { full_kpa: *full_kpa, ..ContactRule::COUNTED };
            let identified =
                Identified { contact, filter: AreaFilter::Direct, side: None, steps: 30, regions: *regions };
            client.set_identified_tissue(&Parameters::typical(InsoleSize::default()).tissue(), identified)
        }
        Event::SetSettings { full_kpa, rate_hz, scale } => {
            let setup = client.setup()?;
            let settings = full_kpa.map(|full_kpa| Settings {
                contact: ContactRule { full_kpa, ..setup.contact },
                period_us: 1_000_000 / *rate_hz,
                scale: *scale,
                ..Settings::of(&setup)
            });
            client.set_settings(settings)?;
            world.borrow_mut().insoles[insole].settings = settings;
            Ok(())
        }
        Event::SetAlerts { window_s, pause_s, per_day, dose_kpa_s } => client.set_alert_rules(&AlertRules {
            limits: LoadLimits { window_s: *window_s, ..LoadLimits::DEFAULT },
            pause_s: *pause_s,
            per_day: *per_day,
            dose_kpa_s: *dose_kpa_s,
            ..AlertRules::OFF
        }),
        Event::Zero => client.zero().map(drop),
        Event::SnoozeAlerts(snoozed_s) => client.snooze_alerts(*snoozed_s).map(drop),
        Event::SetSerial(serial) => {
            let identity = client.identity()?;
            // `EventCheck` has verified that it is valid.
            let serial = Serial::new(serial).unwrap_or(Serial::NONE);
            client.set_identity(identity.side, serial).map(drop)
        }
        Event::EraseWearer => client.erase_wearer(),
        Event::Restart => client.send(ToDevice::Restart),
        Event::ConfirmUpdate => client.update(Request::Confirm).map(drop),
        Event::Update { version, defect } => {
            let image = image(version, *defect);
            let Progress::Next(first) = client.update(Request::Begin(image.offer()))? else { return Ok(()) };
            for number in first..image.offer().chunks {
                client.update(Request::Chunk { number, chunk: image.chunk(number) })?;
            }
            client.update(Request::Finish).map(drop)
        }
        _ => Ok(()),
    }
}

/// The longest duration of a walk, s. It begins with a swing phase of 0.4 s, and so does each repetition after eight steps; a
/// step takes at most 1.07 s with the swing phase after it.
fn longest_walk_s(steps: u32) -> f64 {
    0.4 + 1.12 * f64::from(steps)
}

/// Finds events that have an invalid value, or are impossible after the previous ones.
struct EventCheck {
    /// Number of insoles.
    insoles: usize,
    /// Time of the previous event, s.
    last_s: f64,
    /// Duration of the scenario, s.
    end_s: f64,
    /// For each insole, the end of its wearer's last walk or rest, s.
    busy_until_s: Vec<f64>,
    /// For each insole, the time at which power is back after the last cut, s.
    off_until_s: Vec<f64>,
    /// For each insole, the time at which its cable is repaired after the last cut, s.
    cut_until_s: Vec<f64>,
    /// For each insole, whether its host has connected and not disconnected.
    is_following: Vec<bool>,
}

impl EventCheck {
    fn new(scenario: &Scenario) -> Self {
        let insoles = scenario.insoles;
        Self {
            insoles,
            last_s: 0.0,
            end_s: scenario.duration_s,
            busy_until_s: vec![0.0; insoles],
            off_until_s: vec![0.0; insoles],
            cut_until_s: vec![0.0; insoles],
            is_following: vec![false; insoles],
        }
    }

    /// Checks the next event; returns the reason why it is impossible, with the remedy.
    fn check(&mut self, Entry { s, insole, event }: &Entry) -> Result<(), String> {
        let (s, insole) = (*s, *insole);
        if !s.is_finite() || s < 0.0 {
            return Err(format!("{s} is no time of an event: use 0 s or later"));
        }
        if s < self.last_s {
            return Err(format!("an event at {s} s follows one at {} s: sort the events by time", self.last_s));
        }
        if s > self.end_s {
            return Err(format!("an event at {s} s is after the end at {} s: extend duration_s", self.end_s));
        }
        if insole >= self.insoles {
            return Err(format!("there is no insole {insole}: set insoles = 2, or use a lower number"));
        }
        self.last_s = s;
        let is_off = s < self.off_until_s[insole];
        // A fault that cannot be parsed is not an action either: it is reported below.
        let is_action = insole_event(event).is_none() && !matches!(event, Event::SensorFault(_));
        match event {
            Event::Walk { .. } | Event::Rest { .. } if s < self.busy_until_s[insole] => {
                return Err("the wearer still walks or rests: let this activity end first".into());
            }
            Event::Walk { steps } => self.busy_until_s[insole] = s + longest_walk_s(*steps),
            Event::Rest { for_s, .. } => self.busy_until_s[insole] = s + for_s,
            Event::PowerCut { .. } | Event::Stall(_) | Event::Panic if is_off => {
                return Err("the insole is off: wait until power is back".into());
            }
            Event::PowerCut { off_s } => self.off_until_s[insole] = s + off_s,
            Event::CableCut { .. } if s < self.cut_until_s[insole] => {
                return Err("the cable is cut already: wait until it is repaired".into());
            }
            Event::CableCut { for_s } => self.cut_until_s[insole] = s + for_s,
            Event::SensorFault(text) => {
                text.parse::<SensorFault>().map_err(|error| error.to_string())?;
            }
            Event::SetSerial(serial) if Serial::new(serial).is_none() => {
                return Err(format!(
                    "`{serial}` is not a valid serial number: use at most 16 ASCII characters without spaces"
                ));
            }
            Event::ValueLength(bytes) if !(20..=MAX_VALUE).contains(bytes) => {
                return Err(format!("no link has values of at most {bytes} bytes: use 20 to {MAX_VALUE}"));
            }
            Event::Connect { .. } => self.is_following[insole] = true,
            Event::Acknowledge(_) | Event::ValueLength(_) => {}
            Event::Disconnect if !self.is_following[insole] => {
                return Err("the host is not connected: connect first".into());
            }
            Event::Disconnect => self.is_following[insole] = false,
            _ if is_action && !self.is_following[insole] => {
                return Err("the host is not connected: connect before it requests anything".into());
            }
            _ => {}
        }
        Ok(())
    }
}

/// One insole at the end of a scenario.
pub struct InsoleOutcome {
    /// The host, with the messages that it received.
    pub host: Host,
    /// The counters of the last boot; `None` if the host has ended its session or the insole did not answer.
    pub status: Option<Status>,
    /// For each boot, the steps and load bouts that the pipeline computed, and the index of the first one that may be lost,
    /// because the boot was cut short soon after it.
    computed: Vec<(Vec<LoadRecord>, usize)>,
    /// Number of frames that the last boot scanned.
    frames: u32,
    /// Number of frames without a complete scan, in all boots, each from the first complete scan to the last.
    frames_without_scan: u32,
    /// Number of frame periods since the start of the last boot.
    elapsed_frames: u32,
    /// The reset reason of each start.
    pub resets: Vec<String>,
    /// The version of the firmware of each start.
    pub versions: Vec<String>,
}

/// A record that was computed this long before a loss of power, a crash or a reset by the supervision is stored, us. The
/// supervision needs a second of this time to detect that the scan, the processing or the serial link is stalled.
const STORED_WITHIN_US: u64 = 3_000_000;

/// The outcome of a scenario.
pub struct Outcome {
    /// Each insole.
    pub insoles: Vec<InsoleOutcome>,
}

impl Outcome {
    /// Reads the insoles' counters through their hosts, and collects the steps and load bouts that the insoles computed.
    pub fn new(world: &SharedWorld, hosts: Vec<Host>) -> Self {
        let collect = |(index, mut host): (usize, Host)| {
            // A slow cable would delay the answer, so its rate is no longer limited.
            world.borrow().insoles[index].cable.borrow_mut().byte_us = 0.0;
            let status = if host.is_following { host.status() } else { None };
            let world = world.borrow();
            let insole = &world.insoles[index];
            let computed = insole.boots.iter().map(|boot| {
                let (records, computed_us): (Vec<_>, Vec<_>) = boot.reference.borrow().records.iter().copied().unzip();
                let may_be_lost = match boot.cut_us {
                    None => records.len(),
                    Some(cut_us) => {
                        let stored = computed_us.partition_point(|&at_us| at_us + STORED_WITHIN_US < cut_us);
                        stored.max(records.len().saturating_sub(STORAGE_QUEUE + 1))
                    }
                };
                (records, may_be_lost)
            });
            let last = insole.boots.last();
            // A start waits two seconds for a silent chip.
            let start_us = if insole.is_chip_silent { 2_000_000 } else { 0 };
            let hello = host.hellos.last();
            let period_us = u64::from(hello.map_or(insole.wearer.borrow().setup().period_us, |hello| hello.period_us));
            InsoleOutcome {
                status,
                computed: computed.collect(),
                frames: last.map_or(0, |boot| boot.reference.borrow().frames),
                frames_without_scan: insole.boots.iter().map(|boot| boot.reference.borrow().frames_without_scan).sum(),
                elapsed_frames: last.map_or(0, |boot| {
                    // The scenario can end before a boot has scanned a frame.
                    (now_us().saturating_sub(boot.from_us + start_us) / period_us) as u32
                }),
                resets: insole.boots.iter().map(|boot| boot.reset.name().to_owned()).collect(),
                versions: insole.boots.iter().map(|boot| boot.version.clone()).collect(),
                host,
            }
        };
        Self { insoles: hosts.into_iter().enumerate().map(collect).collect() }
    }

    /// Checks the invariants of all scenarios: every computed step and load bout arrives once, in order and unchanged, except the
    /// last ones of a boot that was cut short, and those of the last boot if the host has ended its session or does not
    /// acknowledge, or if the insole counts as many dropped records; numbers increase; counters are consistent. Returns the
    /// number of steps and load bouts of each insole that did not arrive.
    ///
    /// # Errors
    /// The first invariant that is violated.
    pub fn verify(&self) -> Result<Vec<usize>, String> {
        let verify = |insole: &InsoleOutcome| {
            let lost = insole.verify_records()?;
            match &insole.status {
                Some(status) => insole.verify_counters(status)?,
                None if insole.host.is_following => return Err("the insole does not answer at the end".to_owned()),
                None => {}
            }
            Ok(lost)
        };
        let numbered = self.insoles.iter().enumerate();
        numbered.map(|(index, insole)| verify(insole).map_err(|error| format!("insole {index}: {error}"))).collect()
    }

    /// Compares the outcome with the expected one.
    ///
    /// # Errors
    /// A list of all differences.
    pub fn compare(&mut self, expect: &Expect) -> Result<(), String> {
        let mut differences = Vec::new();
        let mut compare = |name: &str, expected: String, found: String| {
            if expected != found {
                differences.push(format!("{name}: expected {expected}, found {found}"));
            }
        };
        let failed_requests: usize = self.insoles.iter().map(|insole| insole.host.failed_requests).sum();
        let steps_of_all: usize = self.insoles.iter().map(|insole| insole.host.steps().count()).sum();
        if let Some(steps) = expect.steps {
            compare("steps", steps.to_string(), steps_of_all.to_string());
        }
        if let Some(bouts) = &expect.bouts {
            let found: Vec<_> = self.insoles[0].host.bouts().map(|bout| bout.kind.name()).collect();
            compare("load bouts", format!("{bouts:?}"), format!("{found:?}"));
        }
        if let Some(alerts) = &expect.alerts {
            let found: Vec<_> = self.insoles[0].host.alerts().map(|alert| alert.start_s()).collect();
            compare("alerts", format!("{alerts:?}"), format!("{found:?}"));
        }
        match self.verify() {
            Ok(lost) if lost[0] <= expect.lost_at_most && lost[1..].iter().all(|&lost| lost == 0) => {}
            Ok(lost) => {
                compare(
                    "lost steps and bouts",
                    format!("at most {}, only of the first insole", expect.lost_at_most),
                    format!("{lost:?}"),
                );
            }
            Err(error) => compare("invariants", "hold".into(), error),
        }
        for other in &self.insoles[1..] {
            compare("resets of the other insole", format!("{:?}", one_start()), format!("{:?}", other.resets));
        }
        let first = &mut self.insoles[0];
        let resets = expect.resets.clone().unwrap_or_else(one_start);
        compare("resets", format!("{resets:?}"), format!("{:?}", first.resets));
        if let Some(sessions) = expect.sessions {
            compare("sessions", sessions.to_string(), first.host.hellos.len().to_string());
        }
        if let Some(repeats) = expect.repeats_records {
            compare("repeats records", repeats.to_string(), (first.host.repetitions() > 0).to_string());
        }
        // A found value is `None` without a session or without an answer, and then differs from every expected value.
        if let Some(faults) = &expect.faults {
            let found = first.host.client.as_mut().and_then(|client| client.faults().ok());
            let name = |fault: &Fault| format!("{} {}", fault.kind.name(), fault.place);
            let found = found.map(|faults| faults.list.iter().map(name).collect::<Vec<_>>());
            compare("faults", format!("{:?}", Some(faults)), format!("{found:?}"));
        }
        if let Some(loses) = expect.loses_live {
            let found = first.host.client.as_ref().map(|client| client.counters().frames_lost > 0);
            compare("loses live frames", format!("{:?}", Some(loses)), format!("{found:?}"));
        }
        let status = first.status;
        if let Some(missed) = expect.frames_missed {
            let found = status.map(|status| status.frames_missed);
            compare("missed frames", format!("{:?}", Some(missed)), format!("{found:?}"));
        }
        if let Some(without_scan) = expect.frames_without_scan {
            compare("frames without scan", without_scan.to_string(), first.frames_without_scan.to_string());
        }
        if let Some(skipped) = expect.frames_skipped {
            let found = status.map(|status| status.frames_skipped);
            compare("skipped frames", format!("{:?}", Some(skipped)), format!("{found:?}"));
        }
        if let Some(rejected) = expect.rejected {
            let found = status.map(|Status { rejected, .. }| [rejected.short, rejected.long, rejected.broken]);
            compare("rejected contacts", format!("{:?}", Some(rejected)), format!("{found:?}"));
        }
        let hello = first.host.hellos.last();
        if let Some(versions) = &expect.versions {
            let mut found: Vec<_> = first.versions.iter().map(String::as_str).collect();
            found.dedup();
            let name = |version| if version == INITIAL_VERSION { "initial" } else { version };
            let found: Vec<_> = found.into_iter().map(name).collect();
            compare("versions", format!("{versions:?}"), format!("{found:?}"));
        }
        if let Some(text) = &expect.last_fault {
            let fault = hello.and_then(|hello| hello.fault.as_deref()).unwrap_or("none");
            compare("last fault", text.clone(), if fault.starts_with(text) { text.clone() } else { fault.into() });
        }
        if let Some(full_kpa) = expect.contact_full_kpa {
            let found = hello.map(|hello| hello.contact_rule.full_kpa);
            compare("full_kpa", format!("{:?}", Some(full_kpa)), format!("{found:?}"));
        }
        if let Some(rate_hz) = expect.rate_hz {
            compare(
                "frames per second",
                format!("{:?}", Some(rate_hz)),
                format!("{:?}", hello.map(|hello| 1_000_000 / hello.period_us)),
            );
        }
        if let Some(serial) = &expect.serial {
            let identity = first.host.client.as_mut().and_then(|client| client.identity().ok());
            let found = identity.map_or(String::new(), |identity| identity.serial.as_str().into());
            compare("serial number", serial.clone(), found);
        }
        if let Some(parameters) = expect.parameters {
            let tissue = first.host.client.as_mut().and_then(|client| client.tissue().ok());
            let found = tissue.map(|tissue| tissue.id != 0);
            compare("has parameters", format!("{:?}", Some(parameters)), format!("{found:?}"));
        }
        if let Some(is_tracked) = expect.is_tracked {
            let last = first.host.steps().last();
            let found = last.map(|step| step.regions.iter().any(|region| region.stiffness_change_percent != 0));
            compare("is tracked", format!("{:?}", Some(is_tracked)), format!("{found:?}"));
        }
        if let Some(text) = &expect.error {
            let has = first.host.errors.iter().any(|error| error.contains(text));
            compare("error", text.clone(), if has { text.clone() } else { format!("{:?}", first.host.errors) });
        }
        if expect.failed_requests != failed_requests {
            let errors: Vec<_> = self.insoles.iter().flat_map(|insole| &insole.host.errors).collect();
            compare(
                "failed requests",
                expect.failed_requests.to_string(),
                format!("{failed_requests} among {errors:?}"),
            );
        }
        if differences.is_empty() { Ok(()) } else { Err(differences.join("\n")) }
    }
}

/// The part of a step or load bout that the [`Reference`](crate::board::Reference) computes too: all but its number, the boots
/// since then, the wall-clock time, and the results of the model, which depend on the wearer's parameters.
fn measured(record: &LoadRecord) -> LoadRecord {
    let step = match record {
        LoadRecord::Bout(bout) => return Bout { number: 0, boots_since: 0, start_unix_us: None, ..*bout }.into(),
        LoadRecord::Alert(alert) => return Alert { number: 0, boots_since: 0, start_unix_us: None, ..*alert }.into(),
        LoadRecord::Step(step) => step,
    };
    let regions = step.regions.map(|region| StepRegion {
        model_peak_dn: 0,
        model_integral_dns: 0,
        deformation_peak_um: 0,
        deformation_rate_peak_dmm_s: 0,
        model_error_bp: 0,
        stiffness_change_percent: 0,
        ..region
    });
    Step { step: 0, boots_since: 0, start_unix_us: None, clamped: 0, refit: 0, regions, ..*step }.into()
}

impl InsoleOutcome {
    /// Verifies that the host received the computed steps and load bouts; returns the number of lost ones.
    fn verify_records(&self) -> Result<usize, String> {
        for pair in self.host.records.windows(2) {
            let (earlier, later) = (pair[0].number(), pair[1].number());
            if !is_after(later, earlier) {
                return Err(format!("record {later} arrived after record {earlier}"));
            }
        }
        // Alerts depend on rules that the reference does not know.
        let arrived = self.host.records.iter().filter(|record| !matches!(record, LoadRecord::Alert(_)));
        let mut arrived = arrived.map(measured).peekable();
        let mut lost = 0;
        for (boot, (computed, may_be_lost)) in self.computed.iter().enumerate() {
            let mut missing = Vec::new();
            for (index, record) in computed.iter().enumerate() {
                if arrived.next_if(|arrived| *arrived == measured(record)).is_none() {
                    missing.push(index);
                }
            }
            // Records of the last boot may still wait on the insole if the host has ended its session or does not acknowledge.
            let is_last = boot + 1 == self.computed.len();
            let is_waiting = !self.host.is_following || !self.host.acknowledges;
            // The insole counts the records that it drops since its start.
            let are_counted = self.status.is_some_and(|status| status.records_dropped as usize == missing.len());
            let may_miss = is_last && (is_waiting || are_counted);
            if let Some(index) = missing.iter().find(|index| *index < may_be_lost && !may_miss) {
                return Err(format!(
                    "boot {boot}: the record with index {index} did not arrive; {} records of this boot are missing",
                    missing.len()
                ));
            }
            lost += missing.len();
        }
        match arrived.next() {
            None => Ok(lost),
            Some(record) => {
                Err(format!("a record at {} us arrived that the pipeline did not compute", record.start().1))
            }
        }
    }

    /// Compares the insole's counters with those of the test.
    fn verify_counters(&self, status: &Status) -> Result<(), String> {
        let computed =
            self.computed.last().map_or(0, |(records, _)| records.iter().filter_map(LoadRecord::step).count()) as u32;
        let check = |name: &str, counter: u32, found: u32, tolerance: u32| {
            if counter.abs_diff(found) > tolerance {
                return Err(format!("{name}: the insole counts {counter}, the test {found}"));
            }
            Ok(())
        };
        check("steps", status.steps, computed, 0)?;
        // A frame may be scanned and not yet processed.
        check("frames", status.frames, self.frames, 1)?;
        // The start of the firmware takes some frame periods.
        let frames = status.frame_times();
        check("frame periods", frames, self.elapsed_frames, 12)?;
        if status.live_sent > status.live_due {
            return Err(format!("live frames: {} were due, {} sent", status.live_due, status.live_sent));
        }
        Ok(())
    }
}

/// A long walk with both feet, for speed measurements and endurance tests.
pub struct LongWalk {
    /// Number of times that the wearer walks and rests.
    pub rounds: usize,
    /// Number of steps of each foot in a round.
    pub steps: u32,
    /// What the wearer does after these steps, each for a number of seconds.
    pub rests: &'static [(Posture, u64)],
    /// Number of frames per second.
    pub rate_hz: f64,
}

impl LongWalk {
    /// Runs the walk, with the left foot connected over the cable, the right one over the radio, and live frames from both.
    /// Calls `progress` with the number of steps that arrived, after each virtual minute and at the end of each walk and rest.
    /// Returns the outcome, and the virtual duration of the walk.
    pub fn run(&self, mut progress: impl FnMut(usize)) -> (Outcome, Duration) {
        let start_us = now_us();
        let world: SharedWorld = Rc::new(RefCell::new(World::new(2, self.rate_hz)));
        let mut hosts: Vec<_> = (0..2).map(|insole| Host::new(&world, insole)).collect();
        hosts[0].connect(LinkKind::Serial, true);
        hosts[1].connect(LinkKind::Bluetooth, true);
        follow(&mut hosts, start_us + 1_000_000);
        let wearers = [0, 1].map(|insole: usize| world.borrow().insoles[insole].wearer.clone());
        for _ in 0..self.rounds {
            let ends_us = wearers.each_ref().map(|wearer| wearer.borrow_mut().walk(now_us(), self.steps));
            let mut until = |end_us: u64| {
                while now_us() < end_us {
                    follow(&mut hosts, (now_us() + 60_000_000).min(end_us));
                    progress(hosts.iter().map(|host| host.steps().count()).sum());
                }
            };
            until(ends_us.into_iter().fold(0, u64::max));
            for &(posture, seconds) in self.rests {
                let for_us = seconds * 1_000_000;
                wearers.iter().for_each(|wearer| wearer.borrow_mut().rest(now_us(), posture, for_us));
                until(now_us() + for_us);
            }
        }
        let end_us = now_us();
        follow(&mut hosts, end_us + (SETTLE_S * 1e6) as u64);
        let walked = Duration::from_micros(now_us() - start_us);
        (Outcome::new(&world, hosts), walked)
    }
}
