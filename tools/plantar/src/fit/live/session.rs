//! The folder of `plantar record`: tables of live frames, steps, load bouts and alerts, with one row per frame or record and
//! region.

use super::LiveSource;
use anyhow::{Context, Result, anyhow, bail, ensure};
use fit::live::LiveSteps;
use parquet::record::Field;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::{Live, Step, StepFoot, StepRegion};
use plantar::{Region, Side};
use recording::Rows;
use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::{Path, PathBuf};

/// The column with the name of the region, in all tables.
const REGION: &str = "region";
/// The columns of the table of steps from which [`step_of`] makes a step, and the columns that identify the row.
const STEP_COLUMNS: [&str; 11] = [
    "session",
    "side",
    "step",
    "start_s",
    "duration_s",
    "sample_s",
    "boots_since",
    REGION,
    "contact_on_kpa",
    "contact_off_kpa",
    "contact_full_kpa",
];
/// The name of the column `boots_since` in tables of earlier versions of this program.
const FORMER_BOOTS_SINCE: &str = "starts_ago";
/// The column that states whether the start of the step is exact enough to compare the feet. Tables of earlier versions of this
/// program do not have it, so it is read only from the tables that have it.
const IS_COMPARABLE: &str = "is_start_comparable";

/// Largest number of rows of the table of live frames: those of eleven hours at 100 Hz. Without these two limits, small files
/// could exhaust the memory, because equal values are compressed; within them, the rows of a table occupy at most 8 GiB.
const MAX_FRAME_ROWS: usize = 1 << 25;
/// Largest number of rows of each other table: those of a quarter of a million records.
const MAX_RECORD_ROWS: usize = 1 << 21;
/// The remedy for a file that cannot be used.
const REMEDY: &str = "remove the file to use the others";

/// Reads the live frames and the steps in the folder; `None` if it has neither table. Fails if only one of the two is missing, or
/// if there are no steps in sessions with live frames.
pub fn read(folder: &Path) -> Result<Option<Vec<LiveSource>>> {
    let (live, steps) = (folder.join("live"), folder.join("steps"));
    if !live.is_dir() && !steps.is_dir() {
        return Ok(None);
    }
    let name = folder.display().to_string();
    for table in [&live, &steps] {
        if !table.is_dir() {
            bail!("{name}: the folder {} is missing: record a walk of several steps", table.display());
        }
    }
    let frames = frames(&live)?;
    let records = records(&steps)?;
    let mut collected = LiveSteps::new();
    for (session, frames) in &frames {
        let records = records.get(session).map_or(&[][..], |records| records);
        collected.session_started();
        collect(&mut collected, frames, records);
    }
    collected.finish();
    let side = collected.side();
    Ok(Some(vec![LiveSource {
        side: side.with_context(|| {
            format!("{name}: no steps with live frames: record a walk of several steps, or omit the folder")
        })?,
        origin: "Live frames and steps that plantar record stored.".into(),
        name,
        steps: collected,
    }]))
}

/// Adds the messages of a session in the order in which an insole sends them: a record follows the last frame of its stance.
fn collect(collected: &mut LiveSteps, frames: &[Live], records: &[Step]) {
    let mut records = records.iter().peekable();
    for frame in frames {
        collected.frame(frame);
        let is_over =
            |step: &&Step| step.boots_since > 0 || step.start_us.saturating_add(step.duration_us.into()) <= frame.t_us;
        while let Some(step) = records.next_if(is_over) {
            collected.step(step);
        }
    }
    records.for_each(|step| collected.step(step));
}

/// The live frames of each session, in the order of their arrival. Only the quantities that a fit uses are read.
fn frames(folder: &Path) -> Result<BTreeMap<i32, Vec<Live>>> {
    let columns = ["session", "sequence", "t_s", REGION, "area_mm2", "measured_force_n"];
    let mut sessions: BTreeMap<i32, Vec<Live>> = BTreeMap::new();
    for_each_row(folder, &columns, MAX_FRAME_ROWS, |row| {
        let frames = sessions.entry(row.integer("session")?).or_default();
        let sequence = row.integer("sequence")? as u32;
        // In a folder from an earlier version of this program, two successive frames have the same number if the insole began to
        // count from 0 between them, because records were lost and sent again.
        if row.region()? == 0 || frames.last().is_none_or(|frame| frame.sequence != sequence) {
            frames.push(Live { sequence, t_us: (row.real("t_s")? * 1e6).round() as u64, ..Live::default() });
        }
        if let Some(frame) = frames.last_mut() {
            let region = &mut frame.regions[row.region()?];
            region.area_mm2 = row.real("area_mm2")?.round() as u16;
            region.measured_dn = (row.real("measured_force_n")? * 10.0).round() as u16;
        }
        Ok(())
    })?;
    Ok(sessions)
}

/// The steps of each session, in the order of their arrival. Only the quantities that a fit uses are read.
fn records(folder: &Path) -> Result<BTreeMap<i32, Vec<Step>>> {
    let columns = [
        &STEP_COLUMNS[..],
        &["saturated", "masked_cells", "measured_force_peak_n"],
        &["ellipse_x_mm", "ellipse_y_mm", "ellipse_r_a_mm", "ellipse_r_b_mm", "ellipse_angle_deg"],
    ];
    let columns = columns.concat();
    let mut sessions: BTreeMap<i32, Vec<Step>> = BTreeMap::new();
    for_each_row(folder, &columns, MAX_RECORD_ROWS, |row| {
        let steps = sessions.entry(row.integer("session")?).or_default();
        let (number, region) = (row.integer("step")? as u32, row.region()?);
        if region == 0 || steps.last().is_none_or(|step| step.step != number) {
            steps.push(step_of(row, number)?);
        }
        if let Some(step) = steps.last_mut() {
            step.saturated |= u8::from(row.flag("saturated")?) << region;
            step.regions[region] = region_of(row)?;
        }
        Ok(())
    })?;
    Ok(sessions)
}

/// The steps in the folder with the times of their heel strikes on the clock of the host, s since 1970, `None` if unknown, and
/// whether these times are exact enough to compare the feet, in the order of their arrival. Only the quantities that the measures
/// of both feet use are read. In a table without the column `is_start_comparable`, no time is exact enough.
pub fn timed_steps(folder: &Path) -> Result<Vec<(Step, Option<f64>, bool)>> {
    let columns = [&STEP_COLUMNS[..], &["start_unix_s", "foot_force_peak_n", "foot_force_integral_n_s"]].concat();
    let mut steps = Vec::new();
    for_each_row(&folder.join("steps"), &columns, MAX_RECORD_ROWS, |row| {
        if row.region()? == 0 {
            let mut step = step_of(row, row.integer("step")? as u32)?;
            step.foot.peak_dn = (row.real("foot_force_peak_n")? * 10.0).round() as u16;
            step.foot.integral_dns = (row.real("foot_force_integral_n_s")? * 10.0).round() as u16;
            let is_comparable = row.flag(IS_COMPARABLE).unwrap_or(false);
            steps.push((step, row.optional("start_unix_s")?, is_comparable));
        }
        Ok(())
    })?;
    Ok(steps)
}

/// The load bouts and alerts in a folder of `plantar record`: the foot and the number of each.
pub fn other_records(folder: &Path) -> Result<Vec<(Side, u32)>> {
    let mut records = Vec::new();
    for folder in ["bouts", "alerts"].map(|table| folder.join(table)).iter().filter(|folder| folder.is_dir()) {
        for_each_row(folder, &["side", REGION, "number"], MAX_RECORD_ROWS, |row| {
            if row.region()? == 0 {
                records.push((row.side()?, row.integer("number")? as u32));
            }
            Ok(())
        })?;
    }
    Ok(records)
}

/// Makes a step from the columns [`STEP_COLUMNS`] of one of its rows. The other quantities have default values.
fn step_of(row: &Row, number: u32) -> Result<Step> {
    let us = |name| anyhow::Ok((row.real(name)? * 1e6).round());
    let kpa = |name| anyhow::Ok(row.real(name)? as f32);
    Ok(Step {
        step: number,
        side: row.side()?,
        start_us: us("start_s")? as u64,
        duration_us: us("duration_s")? as u32,
        sample_us: us("sample_s")? as u32,
        bridged_frames: 0,
        saturated: 0,
        clamped: 0,
        contact_rule: ContactRule {
            on_kpa: kpa("contact_on_kpa")?,
            off_kpa: kpa("contact_off_kpa")?,
            full_kpa: kpa("contact_full_kpa")?,
        },
        regions: [StepRegion::default(); 8],
        boots_since: row.integer("boots_since").or_else(|_| row.integer(FORMER_BOOTS_SINCE))? as u32,
        start_unix_us: None,
        refit: 0,
        foot: StepFoot::default(),
    })
}

/// The quantities of a region in a step that a fit uses. The columns of the ellipse are empty without contact.
fn region_of(row: &Row) -> Result<StepRegion> {
    let scaled = |name, per_unit: f64| anyhow::Ok((row.optional(name)?.unwrap_or(0.0) * per_unit).round());
    Ok(StepRegion {
        measured_peak_dn: scaled("measured_force_peak_n", 10.0)? as u16,
        masked_cells: row.integer("masked_cells")? as u8,
        ellipse_x_dmm: scaled("ellipse_x_mm", 10.0)? as i16,
        ellipse_y_dmm: scaled("ellipse_y_mm", 10.0)? as i16,
        ellipse_r_a_cmm: scaled("ellipse_r_a_mm", 100.0)? as u16,
        ellipse_r_b_cmm: scaled("ellipse_r_b_mm", 100.0)? as u16,
        ellipse_angle_ddeg: scaled("ellipse_angle_deg", 10.0)? as i16,
        ..StepRegion::default()
    })
}

/// Calls `act` with the rows of all Parquet files in the folder, in the order of the names of the files. Fails if they have more
/// than `max_rows` rows together.
fn for_each_row(
    folder: &Path,
    columns: &[&'static str],
    max_rows: usize,
    mut act: impl FnMut(&Row) -> Result<()>,
) -> Result<()> {
    let mut rows_left = max_rows;
    for file in files(folder).with_context(|| format!("cannot read {}", folder.display()))? {
        let is_needed = |name: &str| columns.contains(&name) || [IS_COMPARABLE, FORMER_BOOTS_SINCE].contains(&name);
        let rows = Rows::open(&file, is_needed, rows_left, REMEDY)?;
        rows_left -= rows.row_count();
        let not_a_table = || format!("{}: not a table of plantar record; {REMEDY}", file.display());
        for column in columns {
            let has_former = *column == "boots_since" && rows.has_column(FORMER_BOOTS_SINCE);
            ensure!(rows.has_column(column) || has_former, "{}: it has no column {column}", not_a_table());
        }
        for row in rows {
            act(&Row(row?)).with_context(not_a_table)?;
        }
    }
    Ok(())
}

/// The Parquet files of a table.
fn files(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if recording::is_parquet(&path) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// A row of a table: the values by the names of their columns.
struct Row(HashMap<String, Field>);

impl Row {
    fn integer(&self, column: &'static str) -> Result<i32> {
        match self.0.get(column) {
            Some(Field::Int(value)) => Ok(*value),
            _ => Err(anyhow!("a value in the column {column} is missing or not an integer")),
        }
    }

    fn optional(&self, column: &'static str) -> Result<Option<f64>> {
        match self.0.get(column) {
            Some(Field::Double(value)) => Ok(Some(*value)),
            Some(Field::Null) => Ok(None),
            _ => Err(anyhow!("a value in the column {column} is not a number")),
        }
    }

    fn real(&self, column: &'static str) -> Result<f64> {
        self.optional(column)?.with_context(|| format!("a value in the column {column} is missing"))
    }

    fn flag(&self, column: &'static str) -> Result<bool> {
        match self.0.get(column) {
            Some(Field::Bool(value)) => Ok(*value),
            _ => Err(anyhow!("a value in the column {column} is missing or not a boolean")),
        }
    }

    /// The index of the region in [`Region::ALL`].
    fn region(&self) -> Result<usize> {
        let region = match self.0.get(REGION) {
            Some(Field::Str(name)) => Region::from_name(name),
            _ => None,
        };
        region.map(|region| region as usize).context("a value in the column region is not the name of a region")
    }

    fn side(&self) -> Result<Side> {
        match self.0.get("side") {
            Some(Field::Str(name)) => [Side::Left, Side::Right].into_iter().find(|side| side.name() == name),
            _ => None,
        }
        .context("a value in the column side is neither left nor right")
    }
}

#[cfg(test)]
mod tests {
    use super::{REGION, REMEDY, STEP_COLUMNS, for_each_row, frames, timed_steps};
    use study::table::{self, Row};

    #[test]
    fn two_successive_frames_with_the_same_number_are_not_merged() {
        let folder = tempfile::tempdir().expect("a folder");
        let row = |t_s: f64, region: &str| -> Row {
            vec![
                ("session", 0.into()),
                ("sequence", 0.into()),
                ("t_s", t_s.into()),
                ("region", region.into()),
                ("area_mm2", 100.0.into()),
                ("measured_force_n", 5.0.into()),
            ]
        };
        let rows = [row(0.01, "heel"), row(0.01, "hallux"), row(0.02, "heel"), row(0.02, "hallux")];
        table::write(&folder.path().join("part-00000.parquet"), None, &rows).expect("written");
        let sessions = frames(folder.path()).expect("frames");
        let times: Vec<u64> = sessions[&0].iter().map(|frame| frame.t_us).collect();
        assert_eq!(times, [10_000, 20_000]);
    }

    #[test]
    fn the_steps_of_an_earlier_version_are_read_without_times_that_can_be_compared() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut row: Row = Vec::new();
        for column in STEP_COLUMNS {
            let value: table::Value = match column {
                "session" | "step" | "boots_since" => 0.into(),
                "side" => "left".into(),
                REGION => "heel".into(),
                _ => 1.0.into(),
            };
            row.push((column, value));
        }
        for column in ["start_unix_s", "foot_force_peak_n", "foot_force_integral_n_s"] {
            row.push((column, 1.0.into()));
        }
        table::write(&folder.path().join("steps/part-00000.parquet"), None, &[row]).expect("written");
        let steps = timed_steps(folder.path()).expect("steps");
        let times: Vec<_> = steps.iter().map(|(_, start_s, is_comparable)| (*start_s, *is_comparable)).collect();
        assert_eq!(times, [(Some(1.0), false)]);
    }

    #[test]
    fn a_file_that_cannot_be_used_is_named_with_the_remedy() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("part-00000.parquet");
        let assert_named = |error: anyhow::Error, problem: &str| {
            let error = format!("{error:#}");
            for part in [&file.display().to_string(), problem, REMEDY] {
                assert!(error.contains(part), "`{part}` not in: {error}");
            }
        };
        // The Parquet library panics when it reads this file.
        std::fs::write(&file, include_bytes!("../../../../../fuzz/corpus/table/negative-start")).expect("written");
        assert_named(frames(folder.path()).expect_err("damaged"), "damaged");
        let row: Row = vec![("number", 0.into())];
        table::write(&file, None, &[row.clone(), row]).expect("written");
        let read = |max_rows| for_each_row(folder.path(), &["number"], max_rows, |_| Ok(()));
        assert_named(read(1).expect_err("more rows than are allowed"), "more than the 1 rows");
        read(2).expect("as many rows as are allowed");
    }
}
