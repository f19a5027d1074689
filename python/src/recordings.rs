//! A recording, and its values as Arrow arrays.

use crate::batch::{Table, table};
use crate::options::named;
use crate::{exception, threads};
use arrow_array::{Array, Float32Array, Float64Array};
use arrow_buffer::{Buffer, ScalarBuffer};
use arrow_data::ArrayData;
use arrow_pyarrow::PyArrowType;
use bytes::Bytes;
use plantar::{Region, Side};
use pyo3::prelude::*;
use recording::footprint::unit_warnings;
use recording::{Layout, Span, template};
use std::path::PathBuf;
use std::sync::Arc;
use study::table::{Row, Value};

/// A recording. It never changes, so the Python arrays of its times and pressures can share its memory.
#[pyclass(frozen, module = "plantar._core")]
pub struct Recording {
    pub inner: Arc<recording::Recording>,
    pub path: PathBuf,
}

/// See [`recording::note_unless_same_sensor`].
#[pyfunction]
pub fn note_unless_same_sensor(recordings: Vec<PyRef<Recording>>, values: &str, verb: &str) -> Option<String> {
    let named = recordings.iter().map(|recording| (recording.path.display().to_string(), &recording.inner.layout));
    let named: Vec<_> = named.collect();
    recording::note_unless_same_sensor(named.iter().map(|(path, layout)| (path.as_str(), *layout)), values, verb)
}

/// The owner of an Arrow buffer. It holds the recording in memory as long as an array uses the buffer. The function returns the
/// bytes of the buffer: those of the times or of the pressures.
struct Shared(Arc<recording::Recording>, fn(&recording::Recording) -> &[u8]);

impl AsRef<[u8]> for Shared {
    fn as_ref(&self) -> &[u8] {
        self.1(&self.0)
    }
}

#[pymethods]
impl Recording {
    /// Reads a recording: a file, or a folder with its parts.
    #[staticmethod]
    fn read(py: Python, path: PathBuf) -> PyResult<Self> {
        threads::begin()?;
        let inner = py.detach(|| recording::Recording::read(&path)).map_err(exception)?;
        Ok(Self { inner: Arc::new(inner), path })
    }

    /// As `read`, from the paths and the contents of the files of a recording, which are in the order of time. `path` is that of
    /// the recording.
    #[staticmethod]
    fn parse(py: Python, files: Vec<(PathBuf, Vec<u8>)>, path: PathBuf) -> PyResult<Self> {
        threads::begin()?;
        let inner = py.detach(|| recording::Recording::parse_parts(files, &path)).map_err(exception)?;
        Ok(Self { inner: Arc::new(inner), path })
    }

    /// A recording of pressures from Python: all cells of the first frame, then those of the next one. `cells` has x, y, mm, and
    /// the area, mm2, of each cell, and `regions` the names of their regions; without them, the template assigns the regions.
    /// `name` is the name of the recording in messages, and `sensor` that of the layout.
    #[staticmethod]
    #[allow(clippy::too_many_arguments, reason = "the fields of a recording")]
    fn from_arrays(
        py: Python,
        t_s: PyArrowType<ArrayData>,
        pressure_kpa: PyArrowType<ArrayData>,
        cells: Vec<(f64, f64, f64)>,
        regions: Option<Vec<String>>,
        side: &str,
        rate_hz: f64,
        name: String,
        sensor: String,
        source: String,
    ) -> PyResult<Self> {
        let side = named("side", side, &[("left", Side::Left), ("right", Side::Right)])?;
        let cell = |(x_mm, y_mm, area_mm2)| recording::Cell { x_mm, y_mm, area_mm2, region: Region::Heel };
        let mut cells: Vec<_> = cells.into_iter().map(cell).collect();
        match regions {
            None => template::assign(&mut cells),
            Some(regions) => {
                let all = Region::ALL.map(|region| (region.name(), region));
                for (cell, region) in cells.iter_mut().zip(&regions) {
                    cell.region = named("region", region, &all)?;
                }
            }
        }
        let inner = recording::Recording {
            side,
            layout: Layout { name: sensor, cells, sheet: None },
            rate_hz,
            source,
            t_s: Float64Array::from(t_s.0).values().to_vec(),
            pressure_kpa: Float32Array::from(pressure_kpa.0).values().to_vec(),
        };
        py.detach(|| inner.check(&name)).map_err(exception)?;
        Ok(Self { inner: Arc::new(inner), path: name.into() })
    }

    /// The frames from `from_s` to `to_s`.
    fn part(&self, py: Python, from_s: Option<f64>, to_s: Option<f64>) -> PyResult<Self> {
        let name = self.path.display().to_string();
        let part = || recording::Recording::clone(&self.inner).part(Span::new(from_s, to_s)?, &name);
        let inner = py.detach(part).map_err(exception)?;
        Ok(Self { inner: Arc::new(inner), path: self.path.clone() })
    }

    /// Writes the recording to a file.
    fn write(&self, py: Python, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.inner.write(&path)).map_err(exception)
    }

    /// See [`recording::footprint::unit_warnings`].
    fn unit_warnings(&self, py: Python) -> Vec<String> {
        py.detach(|| unit_warnings(&self.inner))
    }

    #[getter]
    fn path(&self) -> String {
        self.path.display().to_string()
    }

    #[getter]
    fn side(&self) -> &'static str {
        self.inner.side.name()
    }

    #[getter]
    fn rate_hz(&self) -> f64 {
        self.inner.rate_hz
    }

    #[getter]
    fn source(&self) -> &str {
        &self.inner.source
    }

    /// The times, s.
    fn t_s(&self) -> PyArrowType<ArrayData> {
        let bytes = Bytes::from_owner(Shared(self.inner.clone(), |recording| bytemuck::cast_slice(&recording.t_s)));
        let values = ScalarBuffer::new(Buffer::from(bytes), 0, self.inner.t_s.len());
        PyArrowType(Float64Array::new(values, None).into_data())
    }

    /// The pressures, kPa: all cells of the first frame, then those of the next one.
    fn pressure_kpa(&self) -> PyArrowType<ArrayData> {
        let shared = Shared(self.inner.clone(), |recording| bytemuck::cast_slice(&recording.pressure_kpa));
        let values = ScalarBuffer::new(Buffer::from(Bytes::from_owner(shared)), 0, self.inner.pressure_kpa.len());
        PyArrowType(Float32Array::new(values, None).into_data())
    }

    /// The cells.
    fn cells(&self) -> PyResult<Table> {
        let row = |(index, cell): (usize, &recording::Cell)| -> Row {
            vec![
                ("cell", Value::Integer(i32::try_from(index).ok())),
                ("x_mm", cell.x_mm.into()),
                ("y_mm", cell.y_mm.into()),
                ("area_mm2", cell.area_mm2.into()),
                ("region", cell.region.name().into()),
            ]
        };
        let rows: Vec<Row> = self.inner.layout.cells.iter().enumerate().map(row).collect();
        // `read` and `parse` refuse a recording without cells.
        Ok(PyArrowType(table(&rows[0], &rows)?))
    }
}
