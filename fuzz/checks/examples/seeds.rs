//! Writes the seeds of the fuzz targets to `fuzz/corpus/`, which has one folder for each target. The seeds are made from computed
//! data. The command is `cargo run --package fuzz-checks --example seeds`.
//!
//! This program does not write the seeds of `jiku` and the seed `footscan-xls` of `vendor`, because nothing in this project
//! writes HDF5 files or Excel files. Those seeds were written from computed trials with h5py, and from the computed step below
//! with xlwt, except `overflow` of `jiku`: this file is damaged, so that a product overflows while it is read. Nor does the
//! program write two damaged Parquet files: the seed `claimed-list.parquet` of `recording` claims to contain a far longer list
//! than it does (docs/reliability.md), and in the seed `negative-start` of `table`, a column begins before the file.

use client::append;
use emulation::EmulatorConfig;
use parameters::{InsoleSize, Parameters};
use plantar::Side;
use plantar::faults::{Fault, FaultKind, Faults, Place};
use plantar::insole::Insole;
use plantar::pipeline::alert::{AlertRules, DailyLoad};
use plantar::pipeline::baseline::ZeroResult;
use plantar::pipeline::bout::BoutKind;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::{AreaFilter, Identified, Tissue};
use plantar::protocol::BLOCK_CELLS;
use plantar::protocol::fragment::Splitter;
use plantar::protocol::update::{Header, Offer, Progress, Request};
use plantar::protocol::{
    Alert, Bout, BoutRegion, CellCoder, CellFrame, CellStream, ContactEllipse, Ellipses, Hello, Identity, Live, MAJOR,
    MAX_FRAME, MAX_MESSAGE, MINOR, Refusal, Reset, Resolution, SETUP_CELLS, Serial, Settings, Status, Step, ToDevice,
    ToHost, decode, encode, frame,
};
use recording::synthetic::{self, SyntheticWalk};
use recording::{FootZero, Format, Options, Plateau, Plateaus, Recording, VirtualInsole, Zero};
use std::collections::BTreeSet;
use std::fmt::Debug;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use study::table::{Row, Value, to_parquet};

/// A stream with the cells of every frame.
const CELLS: CellStream = CellStream { resolution: Resolution::Converter, every: 1 };
/// A contact ellipse under the heel.
const ELLIPSE: ContactEllipse =
    ContactEllipse { x_dmm: 350, y_dmm: 300, r_a_cmm: 2_500, r_b_cmm: 2_750, angle_ddeg: 100 };
/// A load bout.
const BOUT: Bout = Bout {
    number: 1,
    side: Side::Left,
    kind: BoutKind::Shuffling,
    start_us: 9_000_000,
    duration_us: 61_230_000,
    regions: [BoutRegion { measured_integral_cns: 123_456, pressure_integral_dkpas: 65_540, peak_pressure_dkpa: 801 };
        8],
    boots_since: 0,
    start_unix_us: Some(1_735_689_600_000_000),
};
/// An alert.
const ALERT: Alert = Alert {
    number: 2,
    side: Side::Left,
    start_us: 901_000_000,
    sustained: 0b10_1001,
    dose: 1,
    window_s: 900,
    today: 3,
    boots_since: 0,
    start_unix_us: Some(1_735_689_600_000_000),
};
/// How the parameters were identified.
const IDENTIFIED: Identified = Identified {
    contact: ContactRule::COVERED,
    filter: AreaFilter::Direct,
    side: Some(Side::Left),
    steps: 30,
    regions: 0xF7,
};

fn main() {
    let recording =
        synthetic::walk(&SyntheticWalk { cells: 8, steps: 1, rate_hz: 50.0, ..Default::default() }).recording;
    let virtual_insole = VirtualInsole::new(&recording, ContactRule::COVERED, StanceRule::ADAPTIVE);
    let parameters = Parameters::typical(InsoleSize::default());
    let tissue = parameters.tissue();
    let (live, step) = live_and_step(&recording, &virtual_insole, &tissue);

    let serial = Serial::new("R-0001").expect("the serial number is valid");
    let fault = Fault { kind: FaultKind::Open, place: Place::Cell(0), found_ms: 1_920 };
    let to_device = [
        ToDevice::Connect { major: MAJOR, minor: MINOR },
        ToDevice::Stream { live: true },
        ToDevice::Acknowledge { number: 0 },
        ToDevice::GetStatus,
        ToDevice::SetTissue(tissue),
        ToDevice::GetTissue,
        ToDevice::GetTime { host_us: 1_735_689_600_000_000 },
        ToDevice::SetClock { unix_us: 1_735_689_600_000_000 },
        ToDevice::GetFaults,
        ToDevice::GetIdentity,
        ToDevice::SetIdentity { side: Side::Right, serial },
        ToDevice::SetCalibrationBlock { block: 0, cells: [CellCalibration::IDEAL; BLOCK_CELLS] },
        ToDevice::SetCalibration { layout_id: virtual_insole.setup.layout_id, cells: 8, id: 1 },
        ToDevice::Restart,
        ToDevice::GetSetup,
        ToDevice::SetSettings(Some(Settings::of(&virtual_insole.setup))),
        ToDevice::GetSettings,
        ToDevice::SetIdentifiedTissue { tissue, identified: IDENTIFIED },
        ToDevice::GetIdentified,
        ToDevice::StreamCells(Some(CELLS)),
        ToDevice::GetSetupCells { first: 0 },
        ToDevice::Update(Request::Begin(Offer {
            header: Header::new("emulated", "1.2.3"),
            chunks: 16,
            signature: [[1; 32]; 2],
        })),
        ToDevice::StreamEllipses { every: 4 },
        ToDevice::GetAlertRules,
        ToDevice::SetAlertRules(AlertRules::RECOMMENDED),
        ToDevice::GetDailyLoad,
        ToDevice::SnoozeAlerts { snoozed_s: 600 },
        ToDevice::Zero,
        ToDevice::EraseWearer,
    ]
    .map(|message| (name("to-device", &message), encoded(&message)));
    let to_host = [
        ToHost::Hello(hello(&virtual_insole, tissue.id)),
        ToHost::Status(Status { uptime_us: 12_345_678, frames: 1000, live_due: 3, live_sent: 2, ..Status::default() }),
        ToHost::Tissue(tissue),
        ToHost::Live(live),
        ToHost::Step(step),
        ToHost::Refused(Refusal::NotUnderstood),
        ToHost::Time { host_us: 1_735_689_600_000_000, device_us: 12_345_678 },
        ToHost::Faults(Faults {
            found: 1,
            rezeroed: 2,
            masked_cells: [1, 0, 0, 0, 0, 0, 0, 0],
            with_former_baseline: [0; 8],
            list: [fault].into_iter().collect(),
        }),
        ToHost::Identity(Identity { side: Side::Right, serial, calibration_id: 1 }),
        ToHost::CalibrationBlock { block: 0 },
        ToHost::Update(Progress::Next(0)),
        ToHost::CellStream(Some(CELLS)),
        ToHost::Cells(cell_frame(&recording, &virtual_insole)),
        ToHost::Setup(virtual_insole.setup),
        ToHost::SetupCells { first: 0, cells: virtual_insole.cells.iter().copied().take(SETUP_CELLS).collect() },
        ToHost::Settings(Some(Settings::of(&virtual_insole.setup))),
        ToHost::Identified(Some(IDENTIFIED)),
        ToHost::Refused(Refusal::CellRate { every: 2 }),
        ToHost::Ellipses(Ellipses { sequence: 0, t_us: 10_000, regions: [ELLIPSE; 8] }),
        ToHost::Refused(Refusal::EllipseRate { every: 4 }),
        ToHost::AlertRules(AlertRules::RECOMMENDED),
        ToHost::DailyLoad(DailyLoad::NONE),
        ToHost::Bout(BOUT),
        ToHost::Alert(ALERT),
        ToHost::Zero(ZeroResult { changed: 3, with_former_baseline: [1, 0, 0, 0, 0, 0, 0, 0], residual_dn: [20; 8] }),
    ]
    .map(|message| (name("to-host", &message), encoded(&message)));
    for (name, message) in &to_device {
        seed("wire", name, message);
        let fragments = fragments(message);
        seed("fragments", name, &pieces(fragments.iter().map(Vec::as_slice)));
    }
    for (name, message) in &to_host {
        seed("wire", name, message);
        seed("phone", name, message);
    }
    seed("deframe", "session", &to_host.iter().flat_map(|(_, message)| framed(message)).collect::<Vec<_>>());
    // Messages of MCUmgr: an echo, the first part of an upload, and a request in two lines of a serial port.
    seed("management", "echo", b"\x0a\0\0\x0a\0\0\x01\0\xa1adfInsole");
    seed(
        "management",
        "upload",
        b"\x0a\0\0\x1f\0\x01\x09\x01\xa3clen\x1a\0\x01\x11pcoff\0ddataJ=\xb8\xf3\x96\0\0\0\0h\0",
    );
    seed("management", "lines", b"\x06\tAAsI\r\n\x04\x14AAABAAEGAKAdoQ==\r\n");
    seed("client", "session", &pieces(to_host.iter().map(|(_, message)| message.as_slice())));

    let session = session(&recording, &virtual_insole);
    seed("identify", "walk", &pieces(session.iter().map(Vec::as_slice)));
    seed("stream", "walk", &stream(&session));

    // The single letters are the events of the target `link`.
    let [connect, stream, acknowledge, status, set_tissue, ..] =
        to_device.each_ref().map(|(_, message)| message.as_slice());
    let session =
        [connect, stream, b"N", b"S", b"L", b"N", b"N", status, b"N", acknowledge, b"S", set_tissue, b"K", b"N", b"C"];
    seed("link", "session", &pieces(session));
    // More steps than the queue of steps can hold.
    let full = [connect, stream].into_iter().chain([&b"S"[..], b"L"].into_iter().cycle().take(40));
    seed("link", "full", &pieces(full));

    seed("set_up", "walk", &set_up_and_walk(&recording, &virtual_insole, &tissue));

    seed("parameters", "typical", parameters.to_toml().as_bytes());
    let zero = FootZero { layout_id: virtual_insole.setup.layout_id, offset_kpa: vec![1.5; recording.cells()] };
    seed("parameters", "zero", Zero { left: None, right: Some(zero) }.to_toml().as_bytes());
    seed("parameters", "thickness", b"heel = 17.5\ntoe_2 = 8\n");
    seed(
        "parameters",
        "participant",
        b"size = 42\nmass_kg = 70.5\nzero = \"zero.toml\"\nthickness = \"tissue.toml\"\n",
    );

    seed("image", "header", &Header::new("emulated", "1.2.3").bytes());

    plateaus();
    csv(&recording);
    seed("pedar", "walk", &pedar());
    vendor();

    let file = tempfile::NamedTempFile::new().expect("the file can be created");
    let short = Recording {
        t_s: recording.t_s[..24].to_vec(),
        pressure_kpa: recording.pressure_kpa[..24 * recording.cells()].to_vec(),
        ..recording
    };
    short.write(file.path()).expect("the recording is written");
    seed("recording", "walk", &fs::read(file.path()).expect("the recording can be read"));
    seed("table", "rows", &table());
}

/// Writes one seed of a target.
///
/// # Panics
/// Panics if this run has already written a seed of this name, which would be lost.
fn seed(target: &str, name: &str, bytes: &[u8]) {
    static WRITTEN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../corpus").join(target);
    let path = folder.join(name);
    let is_first = WRITTEN.lock().expect("no panic").insert(path.clone());
    assert!(is_first, "{target} has two seeds with the name {name}");
    fs::create_dir_all(&folder).expect("the folder can be created");
    fs::write(path, bytes).expect("the seed is written");
}

/// The readings of an insole with few cells at four pressures.
fn plateaus() {
    let insole = VirtualInsole::new(
        &synthetic::walk(&SyntheticWalk { steps: 1, ..Default::default() }).recording,
        ContactRule::COUNTED,
        StanceRule::ADAPTIVE,
    );
    let mut plateaus = Plateaus::new(&insole.setup, &insole.cells[..12], "P-0001", "1.0.0");
    for (pressure_kpa, code) in [(0.0, 6000), (50.0, 12_000), (100.0, 16_400), (200.0, 24_100)] {
        let frame: Vec<u16> = (0..12).map(|cell| code + 10 * cell).collect();
        plateaus.plateaus.extend(Plateau::of(pressure_kpa, pressure_kpa, 0, &vec![frame; 3]));
    }
    let file = tempfile::NamedTempFile::new().expect("the file can be created");
    plateaus.write(file.path()).expect("the plateaus are written");
    seed("plateaus", "four", &fs::read(file.path()).expect("the plateaus can be read"));
}

/// A table with a column of each type, in two row groups.
fn table() -> Vec<u8> {
    let row = |side: &str, number: i32, start_s: Option<f64>| -> Row {
        let is_exact = start_s.is_some();
        vec![
            ("side", side.into()),
            ("number", number.into()),
            ("start_s", Value::Real(start_s)),
            ("is_exact", is_exact.into()),
        ]
    };
    let groups = [vec![row("left", 0, Some(0.5)), row("left", 1, None)], vec![row("right", 2, Some(1.5))]];
    to_parquet(Vec::new(), None, &groups[0][0], &groups).expect("the table is written")
}

/// The name of the seed with a message: `direction` and the name of the message, such as `to-host-daily-load`. That of a refusal
/// contains the reason.
fn name(direction: &str, message: &impl Debug) -> String {
    // The text begins with the name of the variant.
    let text = format!("{message:?}").replacen("Refused(", "Refused", 1);
    let mut name = direction.to_owned();
    for letter in text.chars().take_while(|letter| letter.is_alphanumeric()) {
        if letter.is_uppercase() {
            name.push('-');
        }
        name.push(letter.to_ascii_lowercase());
    }
    name
}

/// A message without framing.
fn encoded<T: serde::Serialize>(message: &T) -> Vec<u8> {
    encode(message, &mut [0; MAX_MESSAGE]).expect("the message fits").to_vec()
}

/// An encoded message with the framing of a byte carrier.
fn framed(message: &[u8]) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let len = frame(message, &mut out);
    out[..len].to_vec()
}

/// Joins pieces in the format that `fuzz_checks::Pieces` splits.
fn pieces<'p>(pieces: impl IntoIterator<Item = &'p [u8]>) -> Vec<u8> {
    // No message is as long as u16::MAX.
    pieces.into_iter().flat_map(|piece| [&(piece.len() as u16).to_le_bytes(), piece].concat()).collect()
}

/// The last live frame of the first stance of a walk, and the step of that stance.
fn live_and_step(recording: &Recording, virtual_insole: &VirtualInsole, tissue: &Tissue) -> (Live, Step) {
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the recording is valid");
    insole.set_tissue(tissue).expect("typical parameters are valid");
    let mut codes = vec![0; virtual_insole.cells.len()];
    let mut live = Live::default();
    for i in 0..virtual_insole.frames(recording) {
        virtual_insole.codes_of(recording, i, &mut codes);
        if insole.frame(i as u32, &codes) {
            return (live, Step::new(&insole.whole_step().expect("the step is complete")));
        }
        if insole.on_ground() {
            live = Live::new(i as u32, i as u64 * 20_000, insole.loads(), insole.masked(), insole.foot_centre_mm());
        }
    }
    panic!("the walk has a step");
}

/// The messages of a session, encoded: the hello, and the live frames and the step of a walk.
fn session(recording: &Recording, virtual_insole: &VirtualInsole) -> Vec<Vec<u8>> {
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the recording is valid");
    let mut codes = vec![0; virtual_insole.cells.len()];
    let mut messages = vec![encoded(&ToHost::Hello(hello(virtual_insole, 0)))];
    for i in 0..virtual_insole.frames(recording) {
        virtual_insole.codes_of(recording, i, &mut codes);
        let is_toe_off = insole.frame(i as u32, &codes);
        let live = Live::new(i as u32, i as u64 * 20_000, insole.loads(), insole.masked(), insole.foot_centre_mm());
        messages.push(encoded(&ToHost::Live(live)));
        if is_toe_off {
            let step = Step::new(&insole.whole_step().expect("the step is complete"));
            messages.push(encoded(&ToHost::Step(step)));
        }
    }
    messages
}

/// The file of a stream with these messages, each of which both insoles sent.
fn stream(messages: &[Vec<u8>]) -> Vec<u8> {
    let mut file = Vec::new();
    for (i, message) in messages.iter().enumerate() {
        let message = decode(message).expect("the message was encoded by this program");
        for insole in [0, 1] {
            append(&mut file, i as u32 * 20, insole, &message).expect("the file is in memory");
        }
    }
    file
}

/// The packed codes of the frame in the middle of a walk.
fn cell_frame(recording: &Recording, virtual_insole: &VirtualInsole) -> CellFrame {
    let mut codes = vec![0; virtual_insole.cells.len()];
    virtual_insole.codes_of(recording, recording.frames() / 2, &mut codes);
    CellCoder::new(CELLS.resolution).pack(1, 0, &codes)
}

/// A hello of this insole.
fn hello(virtual_insole: &VirtualInsole, tissue_id: u32) -> Hello {
    Hello {
        major: MAJOR,
        minor: MINOR,
        firmware: "0.1.0".try_into().expect("the text fits"),
        board: "emulated".try_into().expect("the text fits"),
        side: Side::Right,
        layout_id: virtual_insole.setup.layout_id,
        cells: virtual_insole.cells.len() as u16,
        period_us: virtual_insole.setup.period_us,
        tissue_id,
        contact_rule: virtual_insole.setup.contact,
        reset: Reset::Panic,
        fault: Some("app.rs:1 panicked".try_into().expect("the text fits")),
    }
}

/// The fragments of a message for the smallest MTU.
fn fragments(message: &[u8]) -> Vec<Vec<u8>> {
    let mut splitter = Splitter::new();
    splitter.buffer()[..message.len()].copy_from_slice(message);
    splitter.start(message.len());
    let mut fragment = [0; 20];
    std::iter::from_fn(|| splitter.next(&mut fragment).map(|len| fragment[..len].to_vec())).collect()
}

/// An input of the target `set_up`: set-up, parameters and the frames of a walk.
fn set_up_and_walk(recording: &Recording, virtual_insole: &VirtualInsole, tissue: &Tissue) -> Vec<u8> {
    let mut setup =
        postcard::to_stdvec(&EmulatorConfig { is_paced: true, ..EmulatorConfig::new(virtual_insole.setup) })
            .expect("the value can be encoded");
    for cell in &virtual_insole.cells {
        setup = postcard::to_extend(cell, setup).expect("the value can be encoded");
    }
    let mut input = (setup.len() as u16).to_le_bytes().to_vec();
    input.extend(setup);
    input.extend(postcard::to_stdvec(&tissue.force_laws).expect("the value can be encoded"));
    let mut codes = vec![0; virtual_insole.cells.len()];
    for i in 0..virtual_insole.frames(recording) {
        virtual_insole.codes_of(recording, i, &mut codes);
        // One frame of the stance is missing, and is bridged.
        input.push(u8::from(i == 30));
        input.extend(codes.iter().map(|code| (code >> 8) as u8));
    }
    input
}

/// Writes the seeds of the target `vendor`: in each text format, a step on a sensor of eight rows and five columns, or on some
/// of its cells.
fn vendor() {
    const ROWS: usize = 8;
    const COLUMNS: usize = 5;
    const FRAMES: usize = 30;
    let kpa = |frame: usize, row: usize, column: usize| {
        // The load moves from the heel, the last row, to the toes. `until_peak` is the time until the row is loaded most, as a
        // share of the step.
        let until_peak = (ROWS - 1 - row) as f64 / ROWS as f64 - frame as f64 / FRAMES as f64;
        (200.0 * (1.0 - 9.0 * until_peak * until_peak).max(0.0) * (1.0 - 0.1 * column as f64)).round()
    };
    // `scale` is the pressure of 1 kPa in the unit of the format: 7.5 mmHg or 0.1 N/cm².
    let table = |frame: usize, separator: &str, scale: f64| -> String {
        let row = |row: usize| {
            let fields = (0..COLUMNS).map(|column| format!("{:.1}", kpa(frame, row, column) * scale));
            fields.collect::<Vec<_>>().join(separator) + "\n"
        };
        (0..ROWS).map(row).collect()
    };
    let mut xsensor = "Units:,mmHg\n".to_owned();
    let mut tekscan = format!(
        "FILENAME walkL.fsx\nSENSOR_TYPE FSCAN\nROWS {ROWS}\nCOLS {COLUMNS}\nROW_SPACING 20 mm\n\
         COL_SPACING 0.7 inches\nSECONDS_PER_FRAME 0.02\n\
         CALIBRATION_POINT_1 75 (Kgs) 4798 (Raw Sum) 24 (Number of Loaded Cells)\nUNITS KPa\nASCII_DATA @@\n"
    );
    let (mut emed, mut footscan) = (String::new(), "Right foot data\n".to_owned());
    let mut moticon = "# time".to_owned();
    let mut loadsol =
        "walk\n\tA-L:heel\tA-L:medial\tA-L\t\tA-R:heel\tA-R:lateral\n[sec]\t[N]\t[N]\t[N]\t[sec]\t[N]\t[N]\n"
            .to_owned();
    let (mut gaitpdb, mut pliance) = (String::new(), "time[secs] 1 2 3 4 5 6 7 8\n".to_owned());
    for side in ["left", "right"] {
        (1..=16).for_each(|cell| moticon += &format!("\t{side} pressure {cell}[N/cm²]"));
        moticon += &format!("\t{side} total force[N]");
    }
    for frame in 0..FRAMES {
        xsensor += &format!("FRAME,{frame}\nTime,08:00:{:.3}\n", frame as f64 * 0.02);
        for name in ["LF", "RF"] {
            xsensor += &format!(
                "SENSOR,HX-{name} 1\nRows,{ROWS}\nColumns,{COLUMNS}\nSensel Width (cm),1.8\nSensel Height (cm),2\n\
                 Contact Area (cm2),100\nEst. Load (N),500\nSENSELS\n{}",
                table(frame, ",", 7.5)
            );
        }
        tekscan += &format!("\nFrame {}\n{}", frame + 1, table(frame, ",", 1.0));
        emed += &format!(
            "\n\tSensor size: 1.8x2.0 cm\tTime/picture: 20 ms\n\tPict-No.: {frame}\n\n\t1\t2\t3\t4\t5\n{}\n\x0c",
            table(frame, "\t", 1.0)
                .lines()
                .enumerate()
                .map(|(row, line)| format!("{row}\t{line}\n"))
                .collect::<String>()
        );
        footscan += &format!("Frame {frame} ({:.2} ms)\n{}\n", frame as f64 * 20.0, table(frame, "\t", 0.1));
        moticon += &format!("\n{:.2}", frame as f64 * 0.02);
        let (time_s, heel_n, front_n) = (frame as f64 * 0.02, kpa(frame, 7, 0), kpa(frame, 1, 0));
        loadsol += &format!("{time_s:.2}\t{heel_n}\t{front_n}\t0\t{time_s:.2}\t{heel_n}\t{front_n}\n");
        // The same numbers are forces in N for gaitpdb and pressures in kPa for pliance.
        let values: Vec<_> = (0..8).map(|sensor| kpa(frame, 7 - sensor, 0)).collect();
        let (fields, total_n) =
            (values.iter().map(f64::to_string).collect::<Vec<_>>().join("\t"), values.iter().sum::<f64>());
        pliance += &format!("{time_s:.2} {}\n", values.iter().map(f64::to_string).collect::<Vec<_>>().join(" "));
        gaitpdb += &format!("{time_s:.2}\t{fields}\t{fields}\t{total_n}\t{total_n}\n");
        for _ in 0..2 {
            (0..16).for_each(|cell| moticon += &format!("\t{:.2}", kpa(frame, cell / 2, cell % 2) * 0.1));
            moticon += &format!("\t{:.2}", kpa(frame, 3, 0));
        }
    }
    for (corner, x_cm, y_cm) in [(1, 0, 0), (2, 2, 0), (3, 2, 3), (4, 0, 3)] {
        let row = |along: fn(usize) -> usize, cm: usize| {
            (0..8).map(|i| (along(i) + cm).to_string()).collect::<Vec<_>>().join(" ")
        };
        pliance +=
            &format!("\nx[{corner}] {}\ny[{corner}] {}\n", row(|i| 2 * (i % 2), x_cm), row(|i| 3 * (i / 2), y_cm));
    }
    let files = [xsensor, tekscan, emed, footscan, moticon, loadsol, gaitpdb, pliance];
    for ((index, format), file) in Format::ALL.iter().enumerate().zip(files) {
        assert!(format.parse(file.as_bytes(), Path::new("seed"), Options::default()).is_ok(), "{}", format.name());
        seed("vendor", format.name(), &[&[index as u8], file.as_bytes()].concat());
        seed(
            "vendor",
            &format!("recognised-{}", format.name()),
            &[&[Format::ALL.len() as u8], file.as_bytes()].concat(),
        );
    }
}

/// Writes the seeds of the targets `layout` and `frames`.
fn csv(recording: &Recording) {
    let mut layout = "cell,x_mm,y_mm,area_mm2,region\n".to_string();
    for (i, cell) in recording.layout.cells.iter().enumerate() {
        layout += &format!("{i},{:.1},{:.1},{:.1},{}\n", cell.x_mm, cell.y_mm, cell.area_mm2, cell.region.name());
    }
    seed("layout", "insole", layout.as_bytes());
    seed("layout", "without-regions", b"cell,x_mm,y_mm,area_mm2\n1,30,200,400\n0,30,20,400\n");
    let mut frames = "t_s,c0,c1\n".to_string();
    for i in 0..recording.frames() {
        let frame = recording.frame(i);
        frames += &format!("{:.2},{:.1},{:.1}\n", recording.t_s[i], frame[0], frame[4]);
    }
    seed("frames", "walk", frames.as_bytes());
}

/// An input of the target `pedar`: the geometry and an export with two sensors for each foot.
fn pedar() -> Vec<u8> {
    let mut text = "side,sensor,area_mm2,x1_mm,y1_mm,x2_mm,y2_mm,x3_mm,y3_mm,x4_mm,y4_mm\n".to_string();
    for (side, x_mm) in [("left", 0), ("right", 100)] {
        for (sensor, y_mm) in [(1, 0), (2, 180)] {
            let (right_mm, above_mm) = (x_mm + 20, y_mm + 20);
            text += &format!(
                "{side},{sensor},400,{x_mm},{y_mm},{right_mm},{y_mm},{right_mm},{above_mm},{x_mm},{above_mm}\n"
            );
        }
    }
    text += "\0file name: walk\npressure values in kPa\ntime[secs] 1 2 1 2\n";
    for i in 0..50 {
        let kpa = [0, 200, 0, 100].map(|peak_kpa| if (10..40).contains(&i) { peak_kpa } else { 0 });
        text += &format!("{:.2} {} {} {} {}\n", f64::from(i) * 0.02, kpa[0], kpa[1], kpa[2], kpa[3]);
    }
    text.into_bytes()
}
