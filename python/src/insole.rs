//! A session with an insole over the network or a serial port.

use crate::exception;
use anyhow::{Context, anyhow};
use client::{Carrier, Error, Event, Framed, Link, READ_TIMEOUT, ReadAhead, ReconnectPolicy};
use client::{alert_to_json, bout_to_json, step_to_json};
use parameters::Parameters;
use plantar::Region;
use plantar::protocol::{Live, LiveRegion, LoadRecord, ToDevice, ToHost};
use pyo3::exceptions::{PyConnectionError, PyRuntimeError};
use pyo3::prelude::*;
use serde_json::{Map, Value as Json, json};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use study::records::{columns, flag_columns};
use study::table::Value;

type AnyLink = Link<Box<dyn Carrier + Send>>;

/// A connected insole.
#[pyclass(frozen, module = "plantar._core")]
pub struct Insole {
    /// `None` after `close`.
    link: Mutex<Option<AnyLink>>,
    name: String,
}

#[pymethods]
impl Insole {
    /// Opens a session with the insole at the network address HOST:PORT if `baud` is `None`, or at a serial port with this bit
    /// rate, bit/s.
    #[staticmethod]
    fn connect(py: Python, address: String, baud: Option<u32>) -> PyResult<Self> {
        let name = address.clone();
        let open = move || carrier(&address, baud).map_err(|error| Error::Open(error.into()));
        let link =
            py.detach(|| Link::connect(Arc::new(open), ReconnectPolicy::STREAM)).map_err(|e| failure(&name, e))?;
        Ok(Self { link: Mutex::new(Some(link)), name })
    }

    /// Side, firmware and settings of the insole, as JSON.
    fn hello(&self, py: Python) -> PyResult<String> {
        self.with_link(py, |link| {
            let hello = link.client().hello();
            let rule = hello.contact_rule;
            Ok(json!({
                "side": hello.side.name(),
                "firmware": hello.firmware.as_str(),
                "board": hello.board.as_str(),
                "cells": hello.cells,
                "rate_hz": 1e6 / f64::from(hello.period_us),
                "tissue_id": hello.tissue_id,
                "contact_on_kpa": rule.on_kpa,
                "contact_off_kpa": rule.off_kpa,
                "contact_full_kpa": rule.full_kpa,
            })
            .to_string())
        })
    }

    /// The next event: its kind, its values as JSON, and the time of the frame, or of the start of the record, on this
    /// computer's clock, s since 1970. `None` if nothing arrived within [`READ_TIMEOUT`], or if another message arrived, which is
    /// no event, or while the link is lost and is opened again on another thread.
    fn next_event(&self, py: Python) -> PyResult<Option<(&'static str, String, Option<f64>)>> {
        let (event, mapping) =
            self.with_link(py, |link| Ok((link.next_event()?, link.client().clock_mapping().clone())))?;
        let seconds = |us: Option<u64>| us.map(|us| us as f64 / 1e6);
        Ok(match event {
            Event::Message(ToHost::Live(live)) => {
                Some(("live", live_to_json(&live).to_string(), seconds(mapping.host_us(live.t_us))))
            }
            Event::Message(message) => LoadRecord::of(&message).map(|record| {
                let (kind, values) = match &record {
                    LoadRecord::Step(step) => ("step", step_to_json(step)),
                    LoadRecord::Bout(bout) => ("bout", bout_to_json(bout)),
                    LoadRecord::Alert(alert) => ("alert", alert_to_json(alert)),
                };
                (kind, values.to_string(), seconds(mapping.start_us(&record)))
            }),
            Event::Started(_) => Some(("started", "{}".into(), None)),
            Event::Lost(error) if error.is_link_failure() => {
                Some(("lost", json!({ "reason": format!("{:#}", anyhow!(error)) }).to_string(), None))
            }
            Event::Lost(error) => return Err(failure(&self.name, error)),
            Event::Timeout => None,
        })
    }

    /// Lets the insole delete its records up to this number: steps, load bouts and alerts are numbered together.
    fn acknowledge(&self, py: Python, number: u32) -> PyResult<()> {
        self.with_link(py, |link| {
            link.send(ToDevice::Acknowledge { number });
            Ok(())
        })
    }

    /// Sends the parameters in a file to the insole, which stores them. Returns notes for the user.
    fn push(&self, py: Python, path: PathBuf) -> PyResult<Vec<String>> {
        let parameters = Parameters::read(&path).map_err(exception)?;
        let tissue = parameters.tissue();
        let mut notes: Vec<String> = parameters.typical_note().into_iter().collect();
        match &parameters.identified {
            None => self.with_link(py, |link| link.client().set_tissue(&tissue))?,
            Some(identified) => {
                let on_insole = identified.on_insole().map_err(exception)?;
                let side = self.with_link(py, |link| {
                    link.client().set_identified_tissue(&tissue, on_insole)?;
                    Ok(link.client().hello().side)
                })?;
                notes.extend(identified.notes_for_insole(side));
            }
        }
        Ok(notes)
    }

    /// Closes the link.
    fn close(&self, py: Python) {
        py.detach(|| *self.locked() = None);
    }
}

impl Insole {
    /// Locks the link, even if a thread panicked while it held the lock: at worst, the next call finds that the link is lost.
    fn locked(&self) -> MutexGuard<'_, Option<AnyLink>> {
        self.link.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls `action` with the link while the global interpreter lock is released. Returns an error after `close`.
    fn with_link<T: Send>(
        &self,
        py: Python,
        action: impl FnOnce(&mut AnyLink) -> Result<T, Error> + Send,
    ) -> PyResult<T> {
        let result = py.detach(|| self.locked().as_mut().map(action));
        match result {
            Some(result) => result.map_err(|error| failure(&self.name, error)),
            None => Err(PyRuntimeError::new_err(format!("{}: the connection was closed: connect again", self.name))),
        }
    }
}

/// The Python exception of a failed session: a `ConnectionError` for the link, otherwise a `RuntimeError`.
fn failure(name: &str, error: Error) -> PyErr {
    let is_link_failure = error.is_link_failure();
    let message = format!("{name}: {:#}", anyhow!(error));
    if is_link_failure { PyConnectionError::new_err(message) } else { PyRuntimeError::new_err(message) }
}

/// Opens the serial port `address` with the bit rate `baud`, bit/s, or a network connection to `address` if `baud` is `None`.
fn carrier(address: &str, baud: Option<u32>) -> anyhow::Result<Box<dyn Carrier + Send>> {
    if let Some(baud) = baud {
        let port = serialport::new(address, baud).timeout(READ_TIMEOUT).open();
        let problem =
            "the serial port cannot be opened: is the insole plugged in, and no other program connected to it?";
        let port = port.context(problem)?;
        return Ok(Box::new(Framed::new(ReadAhead::new(port.try_clone()?, port))));
    }
    let remedy = "is the insole or its bridge running there, or is another program connected to it?";
    let problem = "the address must have the form HOST:PORT, and this computer must know the host";
    let mut last_error = anyhow!(problem);
    for address in address.to_socket_addrs().context(problem)? {
        match TcpStream::connect_timeout(&address, ReconnectPolicy::STREAM.answer) {
            Ok(stream) => {
                stream.set_read_timeout(Some(READ_TIMEOUT))?;
                stream.set_nodelay(true)?;
                return Ok(Box::new(Framed::new(stream)));
            }
            Err(error) => last_error = anyhow!(error).context(remedy),
        }
    }
    Err(last_error)
}

/// A live frame as an object; the key `regions` has an object for each region by its name.
fn live_to_json(live: &Live) -> Json {
    let object = |values: &mut dyn Iterator<Item = (&'static str, Value)>| -> Map<String, Json> {
        values.map(|(name, value)| (name.into(), value_to_json(value))).collect()
    };
    let mut frame = object(&mut columns(Live::QUANTITIES, live));
    let regions = Region::ALL.iter().zip(&live.regions).enumerate().map(|(i, (region, live_region))| {
        let mut values = columns(LiveRegion::QUANTITIES, live_region).chain(flag_columns(Live::FLAGS, live, i));
        (region.name().into(), object(&mut values).into())
    });
    frame.insert("regions".into(), regions.collect::<Map<_, _>>().into());
    frame.into()
}

fn value_to_json(value: Value) -> Json {
    match value {
        Value::Text(text) => text.into(),
        Value::Integer(value) => value.into(),
        Value::Real(value) => value.into(),
        Value::Flag(value) => value.into(),
    }
}
