//! Publishes the messages of an insole as streams of the Lab Streaming Layer: frames, steps, load bouts and alerts as numbers,
//! and heel strikes and toe offs as markers.

use crate::Error;
use crate::liblsl::{Liblsl, Now, Outlet, Properties, Stream};
use client::ClockMapping;
use plantar::pipeline::bout::BoutKind;
use plantar::protocol::{
    Alert, Bout, BoutRegion, Flag, Hello, Live, LiveRegion, LoadRecord, Quantity, Step, StepFoot, StepRegion, ToHost,
};
use plantar::{Region, Side};

/// The last part of the name of each stream. [`stream_name`] adds the side.
const NAMES: [&str; 5] = ["frames", "steps", "bouts", "alerts", "events"];
/// The unit of a channel that is 1 if a property is present, and 0 if not.
const FLAG: &str = "boolean";

/// The streams of one insole, until this value is dropped.
pub(crate) struct Outlets {
    lsl: Liblsl,
    side: Side,
    /// The properties in the description of the streams.
    properties: Properties,
    serial: String,
    frames: Numbers<Live>,
    steps: Numbers<Step>,
    bouts: Numbers<Bout>,
    alerts: Numbers<Alert>,
    events: Outlet,
}

impl Outlets {
    /// Publishes the streams of the insole that sent this hello. `serial` is its serial number, empty for none.
    pub fn new(lsl: Liblsl, hello: &Hello, serial: &str) -> Result<Self, Error> {
        let stream = |name: &str, content, channels, is_text| {
            let name = stream_name(hello.side, name);
            let source_id = if serial.is_empty() { String::new() } else { format!("{name}_{serial}") };
            let stream = Stream { name, content, source_id, properties: properties(hello, serial), channels, is_text };
            lsl.publish(&stream).ok_or(Error::Stream(stream.name))
        };
        let outlet = |name: &str, channels| stream(name, "Insole", channels, false);
        let [frames, steps, bouts, alerts, events] = NAMES;
        Ok(Self {
            lsl,
            side: hello.side,
            properties: properties(hello, serial),
            serial: serial.to_owned(),
            frames: Numbers::new(frame_channels(), |channels| outlet(frames, channels))?,
            steps: Numbers::new(step_channels(), |channels| outlet(steps, channels))?,
            bouts: Numbers::new(bout_channels(), |channels| outlet(bouts, channels))?,
            alerts: Numbers::new(alert_channels(), |channels| outlet(alerts, channels))?,
            events: stream(events, "Markers", vec![vec![("label", "event".into())]], true)?,
        })
    }

    /// True if the description of the streams holds for the insole that sent this hello.
    pub fn describes(&self, hello: &Hello) -> bool {
        self.properties == properties(hello, &self.serial)
    }

    /// The names of the streams, separated by commas.
    pub fn names(&self) -> String {
        NAMES.map(|name| stream_name(self.side, name)).join(", ")
    }

    /// Sends a message with its time. A message without a known time is not sent: a frame or record that arrives before the first
    /// answer to a request for the insole's time, and a record from before the insole's last start if its clock was not set then.
    /// Neither is a message from before LSL's clock began (see [`lsl_s`]).
    pub fn send(&mut self, message: &ToHost, mapping: &ClockMapping) {
        let now = self.lsl.now();
        if let ToHost::Live(live) = message
            && let Some(t_s) = mapping.host_us(live.t_us).and_then(|us| lsl_s(now, us))
        {
            self.frames.push(live, t_s);
        }
        let Some(record) = LoadRecord::of(message) else { return };
        let Some(start_us) = mapping.start_us(&record) else { return };
        let Some(start_s) = lsl_s(now, start_us) else { return };
        match record {
            LoadRecord::Step(step) => {
                self.steps.push(&step, start_s);
                self.events.push_text("heel_strike", start_s);
                self.events.push_text("toe_off", start_s + step.duration_s());
            }
            LoadRecord::Bout(bout) => self.bouts.push(&bout, start_s),
            LoadRecord::Alert(alert) => self.alerts.push(&alert, start_s),
        }
    }
}

fn stream_name(side: Side, name: &str) -> String {
    format!("plantar_{}_{name}", side.name())
}

/// The time on LSL's clock, s, at `unix_us` on this computer's clock. `None` before LSL's clock began, because 0 and negative
/// times have a special meaning for liblsl.
fn lsl_s(now: Now, unix_us: u64) -> Option<f64> {
    // Negative for a time in the future.
    let elapsed_us = now.unix_us.wrapping_sub(unix_us) as i64;
    Some(now.lsl_s - elapsed_us as f64 / 1e6).filter(|t_s| *t_s > 0.0)
}

/// The properties that describe the insole, which are the same for all of its streams.
fn properties(hello: &Hello, serial: &str) -> Properties {
    let rule = &hello.contact_rule;
    vec![
        ("manufacturer", "Plantar".into()),
        ("side", hello.side.name().into()),
        ("serial_number", serial.into()),
        ("board", hello.board.as_str().into()),
        ("firmware", hello.firmware.as_str().into()),
        ("cells", hello.cells.to_string()),
        ("frame_rate_hz", (1e6 / f64::from(hello.period_us)).to_string()),
        ("contact_on_kpa", rule.on_kpa.to_string()),
        ("contact_off_kpa", rule.off_kpa.to_string()),
        ("contact_full_kpa", rule.full_kpa.to_string()),
    ]
}

/// A channel of the stream with the messages `M`.
struct Channel<M> {
    region: Option<Region>,
    name: &'static str,
    unit: &'static str,
    meaning: &'static str,
    value: ValueOf<M>,
}

/// Reads a value from a message; `None` if the message lacks it.
type ValueOf<M> = Box<dyn Fn(&M) -> Option<f64> + Send>;

impl<M> Channel<M> {
    fn properties(&self) -> Properties {
        let label = self.region.map_or(self.name.into(), |region| format!("{}_{}", region.name(), self.name));
        let mut properties = vec![
            ("label", label),
            ("unit", self.unit.into()),
            ("type", self.name.into()),
            ("meaning", self.meaning.into()),
        ];
        properties.extend(self.region.map(|region| ("region", region.name().into())));
        properties
    }
}

/// A stream of numbers: one sample for each message `M`.
struct Numbers<M> {
    channels: Vec<Channel<M>>,
    outlet: Outlet,
}

impl<M> Numbers<M> {
    fn new(
        channels: Vec<Channel<M>>,
        publish: impl FnOnce(Vec<Properties>) -> Result<Outlet, Error>,
    ) -> Result<Self, Error> {
        let outlet = publish(channels.iter().map(Channel::properties).collect())?;
        Ok(Self { channels, outlet })
    }

    fn push(&mut self, message: &M, t_s: f64) {
        let value = |channel: &Channel<M>| (channel.value)(message).unwrap_or(f64::NAN);
        self.outlet.push(&self.channels.iter().map(value).collect::<Vec<_>>(), t_s);
    }
}

fn frame_channels() -> Vec<Channel<Live>> {
    let foot = of_foot(Live::QUANTITIES, |live| live);
    let regions = of_regions::<_, LiveRegion>(LiveRegion::QUANTITIES, |live: &Live| &live.regions);
    foot.chain(regions).chain(flags(Live::FLAGS)).collect()
}

fn step_channels() -> Vec<Channel<Step>> {
    let foot = of_foot(Step::QUANTITIES, |step| step).chain(of_foot(StepFoot::QUANTITIES, |step: &Step| &step.foot));
    let regions = of_regions(StepRegion::QUANTITIES, |step: &Step| &step.regions);
    foot.chain(regions).chain(flags(Step::FLAGS)).collect()
}

fn bout_channels() -> Vec<Channel<Bout>> {
    let kinds = BoutKind::ALL.map(|kind| Channel {
        region: None,
        name: kind.name(),
        unit: FLAG,
        meaning: "The bout has this kind.",
        value: Box::new(move |bout: &Bout| Some(f64::from(u8::from(bout.kind == kind)))),
    });
    let regions = of_regions(BoutRegion::QUANTITIES, |bout: &Bout| &bout.regions);
    of_foot(Bout::QUANTITIES, |bout| bout).chain(kinds).chain(regions).collect()
}

fn alert_channels() -> Vec<Channel<Alert>> {
    of_foot(Alert::QUANTITIES, |alert| alert).chain(flags(Alert::FLAGS)).collect()
}

/// The channels of quantities of the whole message, or of a part of it.
fn of_foot<M: 'static, P: 'static>(
    quantities: &'static [Quantity<P>],
    part: fn(&M) -> &P,
) -> impl Iterator<Item = Channel<M>> {
    quantities.iter().map(move |quantity| Channel {
        region: None,
        name: quantity.name,
        unit: quantity.unit,
        meaning: quantity.meaning,
        value: Box::new(move |message| quantity.in_unit(part(message))),
    })
}

/// The channels of quantities of the regions.
fn of_regions<M: 'static, R: 'static>(
    quantities: &'static [Quantity<R>],
    regions: fn(&M) -> &[R; 8],
) -> impl Iterator<Item = Channel<M>> {
    let of_region = move |region: Region| {
        quantities.iter().map(move |quantity| Channel {
            region: Some(region),
            name: quantity.name,
            unit: quantity.unit,
            meaning: quantity.meaning,
            value: Box::new(move |message: &M| quantity.in_unit(&regions(message)[region as usize])),
        })
    };
    Region::ALL.into_iter().flat_map(of_region)
}

/// The channels of flags: 1 for a region that has the property of the flag, and 0 for another region.
fn flags<M: 'static>(flags: &'static [Flag<M>]) -> impl Iterator<Item = Channel<M>> {
    let of_region = move |region: Region| {
        flags.iter().map(move |flag| Channel {
            region: Some(region),
            name: flag.name,
            unit: FLAG,
            meaning: flag.meaning,
            value: Box::new(move |message: &M| Some(f64::from(u8::from(flag.is_set(message, region as usize))))),
        })
    };
    Region::ALL.into_iter().flat_map(of_region)
}
