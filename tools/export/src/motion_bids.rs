//! A folder in the layout of Motion-BIDS, the extension of the Brain Imaging Data Structure for motion data.
//!
//! Force, area and centre of pressure have no channel type of their own in this standard, so all channels have the type `MISC`.

use crate::Session;
use crate::session::content;
use recording::{Result, output};
use serde_json::{Value, json};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// The version of the BIDS standard.
const BIDS_VERSION: &str = "1.10.0";

/// The names of a data set's only participant and task. The standard allows only letters and digits in them.
#[derive(Clone, Debug)]
pub struct Names {
    /// Name of the participant, such as `01`.
    pub subject: String,
    /// Name of the task, such as `walking`.
    pub task: String,
}

/// Writes a new folder with a data set of one participant. `program` is the name and version of the exporting program.
///
/// # Errors
/// Fails if `path` exists or cannot be written, or a name is empty or has other characters than letters and digits.
pub fn write(session: &Session, names: &Names, program: &str, path: &Path) -> Result<()> {
    let place = path.display().to_string();
    for name in [&names.subject, &names.task] {
        if name.is_empty() || !name.chars().all(|character| character.is_ascii_alphanumeric()) {
            let problem = format!("`{name}` is not a valid name of a subject or task");
            return Err(content(&place, problem, "use letters and digits, such as --subject 01 --task walking"));
        }
    }
    if path.exists() {
        return Err(content(&place, "it exists already".into(), "name a new folder, or remove this one"));
    }
    output::at(path, |folder| {
        fs::create_dir(folder)?;
        write_data_set(session, names, program, folder)
    })
}

fn write_data_set(session: &Session, names: &Names, program: &str, folder: &Path) -> io::Result<()> {
    let Names { subject, task } = names;
    let motion = folder.join(format!("sub-{subject}/motion"));
    fs::create_dir_all(&motion)?;
    let prefix = format!("sub-{subject}_task-{task}_tracksys-insole");
    let in_motion = |suffix: &str| motion.join(format!("{prefix}_{suffix}"));
    write_json(&folder.join("dataset_description.json"), &description(session, program))?;
    fs::write(folder.join("README.md"), readme(session, program))?;
    fs::write(folder.join("participants.tsv"), format!("participant_id\nsub-{subject}\n"))?;
    write_json(&in_motion("motion.json"), &sidecar(session, task, program))?;
    write_json(&in_motion("channels.json"), &channel_frames())?;
    write_table(&in_motion("channels.tsv"), |to| write_channels(session, to))?;
    write_table(&in_motion("motion.tsv"), |to| write_samples(session, to))?;
    write_json(&in_motion("events.json"), &event_columns())?;
    write_table(&in_motion("events.tsv"), |to| write_events(session, to))
}

fn description(session: &Session, program: &str) -> Value {
    json!({
        "Name": "Plantar force of an instrumented insole",
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{ "Name": program }],
        "SourceDatasets": session.feet.iter().map(|foot| json!({ "Description": foot.source })).collect::<Vec<_>>(),
    })
}

fn readme(session: &Session, program: &str) -> String {
    let mut text = format!(
        "# Plantar force of an instrumented insole\n\nExported by {program}.\n\nThe channels are in foot coordinates: x from the \
         medial edge to the lateral side, y from the back of the heel to the toes, for left and right feet. Force is normal to \
         the insole. The standard has no channel type for force, area and centre of pressure, so all channels have the type \
         MISC. The centre of pressure is n/a while the foot is off the ground.\n\n"
    );
    for foot in &session.feet {
        text += &format!("{} foot: {}\n\n", foot.side.name(), foot.source);
    }
    text
}

/// The description of the recording.
fn sidecar(session: &Session, task: &str, program: &str) -> Value {
    json!({
        "TaskName": task,
        "TaskDescription": "Recorded with an instrumented insole",
        "SamplingFrequency": session.rate_hz,
        "SamplingFrequencyEffective": session.rate_hz,
        "RecordingType": "continuous",
        "RecordingDuration": session.frames() as f64 / session.rate_hz,
        // A key of this project: the time of the first sample, s, on the clock of the recordings.
        "RecordingStartTime": session.t_s[0],
        "TrackingSystemName": "insole",
        "SoftwareVersions": program,
        "MotionChannelCount": session.channels().len(),
        "MISCChannelCount": session.channels().len(),
        "TrackedPointsCount": session.feet.len(),
        "MissingValues": "n/a",
    })
}

/// The reference frame of the channels.
fn channel_frames() -> Value {
    json!({
        "reference_frame": {
            "Description": "The coordinate system of the channel",
            "Levels": {
                "foot": {
                    "Description": "Foot coordinates, the same for both feet: x from the medial edge to the lateral side, y from \
                                    the back of the heel to the toes",
                    "SpatialAxes": "n/a",
                    "RotationRule": "n/a",
                    "RotationOrder": "n/a",
                },
            },
        },
    })
}

fn event_columns() -> Value {
    json!({
        "trial_type": {
            "Description": "Heel strike or toe off, as the insole detects them",
            "Levels": {
                "left_heel_strike": "Heel strike of the left foot",
                "left_toe_off": "Toe off of the left foot",
                "right_heel_strike": "Heel strike of the right foot",
                "right_toe_off": "Toe off of the right foot",
            },
        },
        "step": { "Description": "Number of the step" },
    })
}

fn write_channels(session: &Session, to: &mut dyn Write) -> io::Result<()> {
    writeln!(to, "name\tcomponent\ttype\ttracked_point\tunits\treference_frame\tdescription")?;
    for channel in session.channels() {
        let (point, quantity) = (channel.side().name(), channel.quantity);
        writeln!(
            to,
            "{}\tn/a\tMISC\t{point}_foot\t{}\tfoot\t{}",
            channel.name(),
            quantity.unit(),
            quantity.description()
        )?;
    }
    Ok(())
}

/// Writes the samples: a row for each frame and a column for each channel, without a header.
fn write_samples(session: &Session, to: &mut dyn Write) -> io::Result<()> {
    let channels = session.channels();
    for i in 0..session.frames() {
        for (column, channel) in channels.iter().enumerate() {
            let separator = if column == 0 { "" } else { "\t" };
            match channel.value(i) {
                Some(value) => write!(to, "{separator}{}", value as f32)?,
                None => write!(to, "{separator}n/a")?,
            }
        }
        writeln!(to)?;
    }
    Ok(())
}

fn write_events(session: &Session, to: &mut dyn Write) -> io::Result<()> {
    writeln!(to, "onset\tduration\ttrial_type\tstep")?;
    for event in session.events() {
        // Rounded to a microsecond: the difference of two times has more digits than the times.
        let onset_s = ((event.t_s - session.t_s[0]) * 1e6).round() / 1e6;
        writeln!(to, "{onset_s}\t0\t{}_{}\t{}", event.side.name(), event.kind.name(), event.step)?;
    }
    Ok(())
}

fn write_json(path: &Path, value: &Value) -> io::Result<()> {
    fs::write(path, format!("{value:#}\n"))
}

fn write_table(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut to = BufWriter::new(File::create(path)?);
    write(&mut to)?;
    to.flush()
}
