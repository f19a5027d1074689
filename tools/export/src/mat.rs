//! MATLAB's format version 7, which GNU Octave and SciPy read, too.

use crate::session::{ascii, content, of_whole_step};
use crate::{Foot, Session};
use matrw::{CellArray, MatFile, MatVariable, MatlabType, NumericArray, Structure, save_matfile_v7};
use plantar::Region;
use plantar::protocol::{Step, StepFoot, StepRegion};
use recording::{Result, output};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Largest number of bytes of a variable in this version of the format.
const MOST_BYTES: u64 = i32::MAX as u64;

/// Writes a file with the variables `rate_hz`, `t_s`, `regions` (the names of the eight regions), and a structure `left` or
/// `right` for each foot. Rows are frames or steps, columns are regions or cells; absent values are NaN. Texts are in ASCII.
///
/// # Errors
/// Fails if the file cannot be written, its path is not UTF-8, or the frames and steps of a foot need more than 31/32 of a
/// variable's limit, 2 GiB.
pub fn write(session: &Session, path: &Path) -> Result<()> {
    for foot in &session.feet {
        // Force and area of each region; total force and the two coordinates of the centre of pressure.
        let frame_bytes = size_of_val(foot.cells_kpa(0)) + size_of::<f64>() * (2 * Region::ALL.len() + 3);
        // Heel strike, toe off, and the columns of the table of steps.
        let columns = 2 + of_whole_step().count() + StepFoot::QUANTITIES.len();
        let of_regions = StepRegion::QUANTITIES.len() + Step::FLAGS.len();
        let step_bytes = size_of::<f64>() * (columns + Region::ALL.len() * of_regions);
        let bytes = (session.frames() * frame_bytes + foot.steps.len() * step_bytes) as u64;
        // The names, the cells and the headers of the arrays take less than the rest.
        if bytes > MOST_BYTES / 32 * 31 {
            let (frames, cells, steps) = (session.frames(), foot.layout.cells.len(), foot.steps.len());
            let problem = format!("{frames} frames of {cells} cells and {steps} steps exceed the 2 GiB of a variable");
            return Err(content(
                &session.files(),
                problem,
                "export parts of it with --from and --to, such as --to 600",
            ));
        }
    }
    output::at(path, |incomplete| {
        let mut file = MatFile::new();
        file.insert("rate_hz", matrix(1, vec![session.rate_hz]));
        file.insert("t_s", column(session.t_s.clone()));
        file.insert("regions", texts(Region::ALL.map(Region::name)));
        for foot in &session.feet {
            file.insert(foot.side.name(), structure(self::foot(foot)));
        }
        let variables = 3 + session.feet.len();
        let name = incomplete.to_str().ok_or_else(|| io::Error::other("the path is not UTF-8"))?;
        save_matfile_v7(name, file, true).map_err(|error| io::Error::other(error.to_string()))?;
        check_complete(&mut File::options().read(true).write(true).open(incomplete)?, variables)
    })
}

/// The fields of a foot.
fn foot(foot: &Foot) -> Vec<(&'static str, MatVariable)> {
    let (frames, steps) = (&foot.frames, &foot.steps);
    let cop = |of: fn((f64, f64)) -> f64| frames.iter().map(move |frame| frame.cop_mm.map_or(f64::NAN, of));
    let cells = foot.layout.cells.len();
    let of_cells = (0..cells).flat_map(|cell| foot.pressure_kpa.iter().skip(cell).step_by(cells).copied());
    vec![
        ("source", text(&foot.source)),
        ("layout", structure(layout(foot))),
        ("total_force_n", column(frames.iter().map(|frame| frame.total_force_n()).collect())),
        ("cop_mm", matrix(frames.len(), cop(|(x_mm, _)| x_mm).chain(cop(|(_, y_mm)| y_mm)).collect())),
        ("measured_force_n", by_region(frames, |frame, region| frame.regions[region].force_n)),
        ("area_mm2", by_region(frames, |frame, region| frame.regions[region].area_mm2)),
        ("pressure_kpa", array(frames.len(), cells, MatlabType::F32(of_cells.collect()))),
        ("heel_strike_s", column(steps.iter().map(|step| step.heel_strike_s).collect())),
        ("toe_off_s", column(steps.iter().map(|step| step.toe_off_s).collect())),
        ("steps", structure(self::steps(&steps.iter().map(|step| step.step).collect::<Vec<_>>()))),
    ]
}

/// The fields of the cells.
fn layout(foot: &Foot) -> Vec<(&'static str, MatVariable)> {
    let cells = |of: fn(&recording::Cell) -> f64| column(foot.layout.cells.iter().map(of).collect());
    vec![
        ("name", text(&foot.layout.name)),
        ("x_mm", cells(|cell| cell.x_mm)),
        ("y_mm", cells(|cell| cell.y_mm)),
        ("area_mm2", cells(|cell| cell.area_mm2)),
        ("region", cells(|cell| f64::from(cell.region as u8) + 1.0)),
    ]
}

/// The quantities of steps: a column for each quantity of the foot, a matrix for each quantity and each flag of the regions.
fn steps(steps: &[Step]) -> Vec<(&'static str, MatVariable)> {
    let value = |of: Option<f64>| of.unwrap_or(f64::NAN);
    let of_step = of_whole_step().map(|q| (q.name, column(steps.iter().map(|s| value(q.in_unit(s))).collect())));
    let of_foot = StepFoot::QUANTITIES
        .iter()
        .map(|q| (q.name, column(steps.iter().map(|step| value(q.in_unit(&step.foot))).collect())));
    let of_regions = StepRegion::QUANTITIES
        .iter()
        .map(|q| (q.name, by_region(steps, |step, region| value(q.in_unit(&step.regions[region])))));
    let flags = Step::FLAGS
        .iter()
        .map(|flag| (flag.name, by_region(steps, |step, region| f64::from(u8::from(flag.is_set(step, region))))));
    of_step.chain(of_foot).chain(of_regions).chain(flags).collect()
}

/// A matrix with a row for each item and a column for each region.
fn by_region<T>(items: &[T], value: impl Fn(&T, usize) -> f64) -> MatVariable {
    let values = (0..Region::ALL.len()).flat_map(|region| items.iter().map(move |item| (item, region)));
    let values: Vec<f64> = values.map(|(item, region)| value(item, region)).collect();
    array(items.len(), Region::ALL.len(), MatlabType::F64(values))
}

fn column(values: Vec<f64>) -> MatVariable {
    array(values.len(), 1, MatlabType::F64(values))
}

/// A matrix with this number of rows. `values` contains the columns one after the other.
fn matrix(rows: usize, values: Vec<f64>) -> MatVariable {
    array(rows, values.len() / rows.max(1), MatlabType::F64(values))
}

fn array(rows: usize, columns: usize, values: MatlabType) -> MatVariable {
    let array = NumericArray::new(vec![rows, columns], values, None);
    MatVariable::NumericArray(array.expect("there is one value for each row and column"))
}

/// A text in ASCII, because the library loses other characters.
fn text(text: &str) -> MatVariable {
    MatVariable::from(ascii(text).as_str())
}

fn texts<const N: usize>(texts: [&str; N]) -> MatVariable {
    let cells = CellArray::new(vec![N, 1], texts.map(text).into());
    MatVariable::CellArray(cells.expect("there is one text for each cell"))
}

fn structure(fields: Vec<(&'static str, MatVariable)>) -> MatVariable {
    MatVariable::Structure(Structure::new(fields.into_iter().map(|(name, value)| (name.into(), value)).collect()))
}

/// Checks that the file ends with its last variable, because the library does not report that a disk is full. A variable begins
/// with a type and the number of bytes that follow.
fn check_complete(file: &mut File, variables: usize) -> io::Result<()> {
    const HEADER: u64 = 128;
    let mut end = HEADER;
    for _ in 0..variables {
        file.seek(SeekFrom::Start(end))?;
        let mut tag = [0; 8];
        file.read_exact(&mut tag).map_err(|_| incomplete())?;
        let [_, _, _, _, bytes @ ..] = tag;
        end += tag.len() as u64 + u64::from(u32::from_le_bytes(bytes));
    }
    file.sync_all()?;
    if file.metadata()?.len() == end { Ok(()) } else { Err(incomplete()) }
}

fn incomplete() -> io::Error {
    io::Error::new(io::ErrorKind::WriteZero, "not all of the file was written")
}
