//! MCAP, for Foxglove and other programs that show recordings of robots: messages in JSON with schemas.

use crate::session::{content, of_whole_step};
use crate::{Channel, EventKind, Foot, Quantity, Session, TimedStep};
use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{Compression, McapResult, WriteOptions, Writer};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use plantar::protocol::{Step, StepFoot, StepRegion};
use plantar::{Region, Side};
use recording::{Cell, Result, output};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::io::{self, Seek, Write};
use std::path::Path;

/// Distance between the medial edges of the two insoles in the point clouds, m.
const GAP_M: f64 = 0.05;
/// Name of the frame of reference of the point clouds of both insoles.
const FRAME: &str = "insoles";
/// `FLOAT32` of the schema `foxglove.PackedElementField`.
const FLOAT32: u8 = 7;
/// Number of values of a point: three coordinates and the pressure.
const POINT: usize = 4;

/// Writes an MCAP file with four topics for each foot: `frame` with the channels, `pressure` with the cells as
/// `foxglove.PointCloud`, `step` with the quantities of a step, and `event`.
///
/// # Errors
/// Fails if a time is negative, or the file cannot be written.
pub fn write(session: &Session, path: &Path) -> Result<()> {
    if session.t_s[0] < 0.0 {
        let problem = format!("its times begin at {} s, and this format has no negative times", session.t_s[0]);
        return Err(content(&session.files(), problem, "export with --from 0"));
    }
    output::file(path, |to| write_to(session, to).map_err(io::Error::other))
}

fn write_to(session: &Session, to: impl Write + Seek) -> McapResult<()> {
    let options = WriteOptions::new().library("plantar").compression(Some(Compression::Lz4));
    let mut to = options.create(to)?;
    let sources = session.feet.iter().map(|foot| (format!("{}_source", foot.side.name()), foot.source.clone()));
    let metadata = sources.chain([("rate_hz".into(), session.rate_hz.to_string())]).collect();
    to.write_metadata(&Metadata { name: "plantar".into(), metadata })?;
    let mut topics = session.feet.iter().map(|foot| Topics::new(foot, &mut to)).collect::<McapResult<Vec<_>>>()?;
    let events = session.events();
    let mut events = events.iter().peekable();
    for (i, t_s) in session.t_s.iter().enumerate() {
        while let Some(event) = events.next_if(|event| event.t_s <= *t_s) {
            let of_foot = topics.iter_mut().find(|topics| topics.foot.side == event.side);
            let Some(topics) = of_foot else { continue };
            let message = json!({ "event": EventKind::name(event.kind), "step": event.step });
            topics.event.write(&mut to, event.t_s, &message)?;
        }
        for topics in &mut topics {
            let channels = Quantity::all().map(|quantity| Channel { foot: topics.foot, quantity });
            let value = |channel: Channel| Some((name(channel.quantity), channel.value(i)?.into()));
            topics.frame.write(&mut to, *t_s, &channels.filter_map(value).collect::<Map<_, _>>().into())?;
            let cloud = topics.cloud(i, *t_s);
            topics.pressure.write(&mut to, *t_s, &cloud)?;
        }
    }
    for topics in &mut topics {
        for step in &topics.foot.steps {
            topics.step.write(&mut to, step.toe_off_s, &step_to_json(step))?;
        }
    }
    to.finish().map(drop)
}

/// A topic to which messages are written.
struct Topic {
    channel_id: u16,
    /// Number of the next message.
    sequence: u32,
}

impl Topic {
    /// `properties` has the JSON schemas of the properties of a message.
    fn new<W: Write + Seek>(
        to: &mut Writer<W>,
        side: Side,
        topic: &str,
        title: &str,
        properties: Value,
    ) -> McapResult<Self> {
        let schema = json!({ "title": title, "type": "object", "properties": properties });
        let schema_id = to.add_schema(title, "jsonschema", schema.to_string().as_bytes())?;
        let topic = format!("/{}/{topic}", side.name());
        Ok(Self { channel_id: to.add_channel(schema_id, &topic, "json", &BTreeMap::new())?, sequence: 0 })
    }

    fn write<W: Write + Seek>(&mut self, to: &mut Writer<W>, t_s: f64, message: &Value) -> McapResult<()> {
        let (channel_id, sequence, log_time) = (self.channel_id, self.sequence, ns(t_s));
        self.sequence += 1;
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        to.write_to_known_channel(&header, message.to_string().as_bytes())
    }
}

/// The topics of a foot.
struct Topics<'a> {
    foot: &'a Foot,
    frame: Topic,
    pressure: Topic,
    step: Topic,
    event: Topic,
}

impl<'a> Topics<'a> {
    fn new<W: Write + Seek>(foot: &'a Foot, to: &mut Writer<W>) -> McapResult<Self> {
        let number = |description: String| json!({ "type": "number", "description": description });
        let frame = Quantity::all()
            .map(|quantity| (name(quantity), number(format!("{}, {}", quantity.description(), quantity.unit()))));
        let step = step_quantities().map(|(name, unit, meaning)| (name, number(format!("{meaning} In {unit}."))));
        let flags = step_flags().map(|(name, meaning)| (name, json!({ "type": "boolean", "description": meaning })));
        let step = step.chain(flags);
        let times =
            ["heel_strike_s", "toe_off_s"].map(|name| (name.into(), number("On the clock of the messages, s".into())));
        let event = json!({ "event": { "type": "string" }, "step": { "type": "integer" } });
        let side = foot.side;
        Ok(Self {
            foot,
            frame: Topic::new(to, side, "frame", "plantar.Frame", frame.collect::<Map<_, _>>().into())?,
            pressure: Topic::new(to, side, "pressure", "foxglove.PointCloud", point_cloud_schema())?,
            step: Topic::new(to, side, "step", "plantar.Step", step.chain(times).collect::<Map<_, _>>().into())?,
            event: Topic::new(to, side, "event", "plantar.Event", event)?,
        })
    }

    /// The pressures of frame `i` as points of the sole, seen from above with the toes in the direction of y.
    fn cloud(&self, i: usize, t_s: f64) -> Value {
        let direction = if self.foot.side == Side::Left { -1.0 } else { 1.0 };
        let point = |(cell, kpa): (&Cell, &f32)| -> [f32; POINT] {
            let x_m = direction * (GAP_M / 2.0 + cell.x_mm / 1e3);
            [x_m as f32, (cell.y_mm / 1e3) as f32, 0.0, *kpa]
        };
        let points = self.foot.layout.cells.iter().zip(self.foot.cells_kpa(i)).flat_map(point);
        let data: Vec<u8> = points.flat_map(f32::to_le_bytes).collect();
        let fields = ["x", "y", "z", "pressure_kpa"];
        let field = |(i, name)| json!({ "name": name, "offset": i * size_of::<f32>(), "type": FLOAT32 });
        let (sec, nsec) = (ns(t_s) / 1_000_000_000, ns(t_s) % 1_000_000_000);
        json!({
            "timestamp": { "sec": sec, "nsec": nsec },
            "frame_id": FRAME,
            "pose": { "position": { "x": 0, "y": 0, "z": 0 }, "orientation": { "x": 0, "y": 0, "z": 0, "w": 1 } },
            "point_stride": POINT * size_of::<f32>(),
            "fields": fields.into_iter().enumerate().map(field).collect::<Vec<_>>(),
            "data": BASE64_STANDARD.encode(data),
        })
    }
}

/// The properties of `foxglove.PointCloud`, as Foxglove defines them.
fn point_cloud_schema() -> Value {
    let object = |properties: Value| json!({ "type": "object", "properties": properties });
    let (number, integer, text) =
        (json!({ "type": "number" }), json!({ "type": "integer" }), json!({ "type": "string" }));
    let vector = json!({ "x": number, "y": number, "z": number });
    let quaternion = json!({ "x": number, "y": number, "z": number, "w": number });
    let field = json!({ "name": text, "offset": integer, "type": integer });
    json!({
        "timestamp": object(json!({ "sec": integer, "nsec": integer })),
        "frame_id": text,
        "pose": object(json!({ "position": object(vector), "orientation": object(quaternion) })),
        "point_stride": integer,
        "fields": { "type": "array", "items": object(field) },
        "data": { "type": "string", "contentEncoding": "base64" },
    })
}

/// The name of a channel within its foot.
fn name(quantity: Quantity) -> String {
    quantity.region().map_or(quantity.name().into(), |region| of_region(region, quantity.name()))
}

fn of_region(region: Region, name: &str) -> String {
    format!("{}_{name}", region.name())
}

/// Name, unit and meaning of the quantities of a step.
fn step_quantities() -> impl Iterator<Item = (String, &'static str, &'static str)> {
    let step = of_whole_step().map(|q| (q.name.into(), q.unit, q.meaning));
    let foot = StepFoot::QUANTITIES.iter().map(|q| (q.name.into(), q.unit, q.meaning));
    let of = |region| StepRegion::QUANTITIES.iter().map(move |q| (of_region(region, q.name), q.unit, q.meaning));
    step.chain(foot).chain(Region::ALL.into_iter().flat_map(of))
}

/// Name and meaning of the flags of a step.
fn step_flags() -> impl Iterator<Item = (String, &'static str)> {
    let of = |region| Step::FLAGS.iter().map(move |flag| (of_region(region, flag.name), flag.meaning));
    Region::ALL.into_iter().flat_map(of)
}

/// A step as an object without the absent quantities.
fn step_to_json(step: &TimedStep) -> Value {
    let TimedStep { heel_strike_s, toe_off_s, step } = step;
    let of_step = of_whole_step().map(|q| q.in_unit(step));
    let of_foot = StepFoot::QUANTITIES.iter().map(|q| q.in_unit(&step.foot));
    let of_regions = step.regions.iter().flat_map(|region| StepRegion::QUANTITIES.iter().map(|q| q.in_unit(region)));
    let names = step_quantities().map(|(name, ..)| name);
    let values = names.zip(of_step.chain(of_foot).chain(of_regions));
    let present = values.filter_map(|(name, value)| Some((name, value?.into())));
    let of_flags =
        (0..Region::ALL.len()).flat_map(|region| Step::FLAGS.iter().map(move |flag| flag.is_set(step, region)));
    let flags = step_flags().zip(of_flags).map(|((name, _), is_set)| (name, is_set.into()));
    let times = [("heel_strike_s".into(), (*heel_strike_s).into()), ("toe_off_s".into(), (*toe_off_s).into())];
    present.chain(flags).chain(times).collect::<Map<_, _>>().into()
}

/// Converts a time that is not negative from s to ns.
fn ns(t_s: f64) -> u64 {
    (t_s * 1e9).round() as u64
}
