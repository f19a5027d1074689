//! Messages of an insole as the page reads them: one object each, `kind` first, units in the names.

use client::step_to_json;
use plantar::Side;
use plantar::faults::Faults;
use plantar::protocol::{Hello, Live, Status, ToHost, decode};
use serde_json::{Value, json};

/// The message as JSON; `None` where the bytes are no message of this version.
pub fn decode_to_json(bytes: &[u8]) -> Option<Value> {
    let message: ToHost = decode(bytes)?;
    Some(match &message {
        ToHost::Hello(hello) => hello_to_json(hello),
        ToHost::Live(live) => live_to_json(live),
        ToHost::Step(step) => json!({ "kind": "step", "step": step_to_json(step) }),
        ToHost::Status(status) => status_to_json(status),
        ToHost::Tissue(tissue) => json!({ "kind": "tissue", "id": tissue.id }),
        ToHost::Refused(refusal) => json!({ "kind": "refused", "reason": refusal.to_string() }),
        // What an insole keeps is nothing the page asks for.
        ToHost::Identity(_) | ToHost::CalibrationBlock { .. } | ToHost::Update(_) => return None,
        ToHost::Time { host_us, device_us } => json!({ "kind": "time", "host_us": host_us, "device_us": device_us }),
        ToHost::Faults(faults) => faults_to_json(faults),
    })
}

fn hello_to_json(hello: &Hello) -> Value {
    json!({
        "kind": "hello",
        "major": hello.major,
        "minor": hello.minor,
        "firmware": hello.firmware.as_str(),
        "board": hello.board.as_str(),
        "side": match hello.side { Side::Left => "left", Side::Right => "right" },
        "cells": hello.cells,
        "rate_hz": 1e6 / f64::from(hello.period_us),
        "has_parameters": hello.tissue_id != 0,
        "reset": hello.reset.name(),
        "last_panic": hello.last_panic.as_deref(),
    })
}

fn live_to_json(live: &Live) -> Value {
    let regions: Vec<_> = live
        .regions
        .iter()
        .enumerate()
        .map(|(i, r)| {
            json!({
                "area_mm2": r.area_mm2,
                "deformation_mm": f64::from(r.deformation_um) / 1000.0,
                "model_n": f64::from(r.model_dn) / 10.0,
                "measured_n": f64::from(r.measured_dn) / 10.0,
                "saturated": live.saturated >> i & 1 == 1,
                "clamped": live.clamped >> i & 1 == 1,
                "masked": live.masked >> i & 1 == 1,
            })
        })
        .collect();
    json!({ "kind": "live", "sequence": live.sequence, "t_s": live.t_us as f64 / 1e6, "regions": regions })
}

fn status_to_json(status: &Status) -> Value {
    json!({
        "kind": "status",
        "uptime_s": status.uptime_us as f64 / 1e6,
        "frames_missed": status.frames_missed,
        "live_due": status.live_due,
        "live_sent": status.live_sent,
        "steps": status.steps,
        "steps_dropped": status.steps_dropped,
        "bad_frames": status.bad_frames,
        "unkept": status.not_stored,
        "faults": status.faults,
        "rezeroed": status.rezeroed,
    })
}

fn faults_to_json(faults: &Faults) -> Value {
    let list: Vec<_> = faults
        .list
        .iter()
        .map(|fault| {
            json!({
                "fault": fault.kind.name(),
                "place": fault.place.to_string(),
                "found_s": f64::from(fault.found_ms) / 1000.0,
            })
        })
        .collect();
    json!({ "kind": "faults", "found": faults.found, "rezeroed": faults.rezeroed, "list": list })
}
