//! Drives `plantar calibrate` with an emulated insole under an even pressure, whose cells have known gains and zeros.

use crate::board::forward;
use emulation::EmulatorConfig;
use emulator::{Board, Scan, Time, Walk};
use plantar::pipeline::calibrate::FULL_CODE;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use recording::VirtualInsole;
use recording::synthetic::{self, SyntheticWalk};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// The pressure device: the present pressure, Pa, and its increase per scan, Pa.
#[derive(Clone, Default)]
struct Bladder {
    pressure_pa: Arc<AtomicU32>,
    rise_pa: Arc<AtomicU32>,
}

impl Bladder {
    fn set(&self, pressure_kpa: f64, rise_pa: u32) {
        self.pressure_pa.store((1000.0 * pressure_kpa) as u32, Ordering::Relaxed);
        self.rise_pa.store(rise_pa, Ordering::Relaxed);
    }
}

/// An insole in the device.
struct Sheet {
    bladder: Bladder,
    full_kpa: f64,
    exponent: f64,
}

/// The gain of a cell.
fn gain(cell: usize) -> f64 {
    0.8 + 0.005 * (cell * 37 % 100) as f64
}

/// The code of a cell without load.
fn zero(cell: usize) -> u16 {
    5900 + cell as u16 % 64
}

impl Walk for Sheet {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, _: u32, codes: &mut [u16]) -> Scan {
        let rise_pa = self.bladder.rise_pa.load(Ordering::Relaxed);
        let pressure_kpa = f64::from(self.bladder.pressure_pa.fetch_add(rise_pa, Ordering::Relaxed)) / 1000.0;
        for (cell, code) in codes.iter_mut().enumerate() {
            let share = (pressure_kpa / gain(cell) / self.full_kpa).powf(self.exponent);
            *code = zero(cell) + (share * f64::from(FULL_CODE)).round() as u16;
        }
        Scan::Whole
    }
}

/// Starts an emulated insole in the device. Returns the board and the network address of its link.
fn board(bladder: &Bladder) -> (Board, String) {
    let firmware = std::env::var_os("PLANTAR_FIRMWARE").expect("PLANTAR_FIRMWARE names the emulated board's firmware");
    let walk = synthetic::walk(&SyntheticWalk { steps: 1, ..Default::default() }).recording;
    let insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let law = insole.setup.sensor;
    let sheet = Sheet { bladder: bladder.clone(), full_kpa: law.full_kpa.into(), exponent: law.exponent.into() };
    let config = EmulatorConfig::new(insole.setup);
    let board = Board::start(Path::new(&firmware), &config, &insole.cells, Time::Real, sheet).expect("the board boots");
    let (address, _) = forward(&board);
    (board, address)
}

/// Runs the command, and passes each line of its output to `respond`, which returns false to close the standard input, and
/// otherwise presses Enter if the line asks for it. Returns whether the command succeeded, and its output.
fn run(arguments: &[&str], mut respond: impl FnMut(&str) -> bool) -> (bool, String) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_plantar"))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut keys = child.stdin.take();
    let mut text = String::new();
    for line in BufReader::new(child.stdout.take().expect("piped")).lines() {
        let line = line.expect("text");
        if !respond(&line) {
            keys = None;
        } else if line.contains("press Enter")
            && let Some(keys) = &mut keys
        {
            keys.write_all(b"\n").expect("the program reads its keys");
        }
        text += &line;
        text.push('\n');
    }
    let output = child.wait_with_output().expect("the program ends");
    (output.status.success(), text + &String::from_utf8_lossy(&output.stderr))
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_insole_is_calibrated_although_the_measurement_is_interrupted() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("calibration");
    let out_text = out.to_str().expect("a path");
    let bladder = Bladder::default();
    let (_board, address) = board(&bladder);
    let measure = |pressures: &'static str| {
        ["calibrate", "measure", "--pressures", pressures, "--out", out_text, "--tcp", &address].map(str::to_string)
    };
    let measured = |pressures, respond: &mut dyn FnMut(&str) -> bool| {
        let arguments = measure(pressures);
        run(&arguments.each_ref().map(String::as_str), respond)
    };

    // Pressures that cannot be evaluated are refused before anything is measured.
    let (is_good, text) = measured("50,100", &mut |_| true);
    assert!(!is_good && text.contains("give 0 kPa") && !out.exists(), "{text}");

    // At the first attempt, the pressure of the second plateau still rises. Then the standard input ends.
    let mut attempts = 0;
    let (is_good, text) = measured("0,50,200,50,0", &mut |line: &str| {
        if line.contains("set 50 kPa") {
            attempts += 1;
            bladder.set(50.0, if attempts == 1 { 200 } else { 0 });
        }
        !line.contains("set 200 kPa")
    });
    assert!(text.contains("the reading changed by +") && attempts == 2, "{text}");
    assert!(!is_good && text.contains("plateau 3 of 5: the plateaus before it are stored"), "{text}");

    let (is_good, text) = measured("0,100,200", &mut |_| true);
    assert!(!is_good && text.contains("[0.0, 50.0] kPa, with which --pressures must begin"), "{text}");

    // On the way back, the sheet reads 4 % more.
    let (is_good, text) = measured("0,50,200,50,0", &mut |line: &str| {
        for (words, kpa) in [("set 200 kPa", 200.0), ("set 50 kPa", 52.0), ("remove all load", 0.0)] {
            if line.contains(words) {
                bladder.set(kpa, 0);
            }
        }
        true
    });
    assert!(is_good && text.contains("2 of 5 plateaus are measured already"), "{text}");
    assert!(text.contains("hysteresis: at 50 kPa, the later reading differs by +4.0 %"), "{text}");

    let check = |text: &str| {
        let lines: Vec<&str> = text.lines().skip(1).collect();
        assert_eq!(lines.len(), 240);
        // Two of the three loaded plateaus are at 50 kPa, one of which reads 4 % more.
        let expected = |cell: usize| gain(cell) / 1.04f64.powf(1.0 / 3.0);
        for (cell, line) in lines.iter().enumerate() {
            let fields: Vec<f64> = line.split(',').map(|field| field.parse().expect("a number")).collect();
            assert_eq!(fields[1], f64::from(zero(cell)), "the zero of cell {cell}");
            assert!(
                (fields[2] / expected(cell) - 1.0).abs() < 0.002,
                "cell {cell}: {} of {:.4}",
                fields[2],
                expected(cell)
            );
        }
    };
    let file = out.join("calibration.csv");
    check(&std::fs::read_to_string(&file).expect("a calibration"));
    std::fs::remove_file(&file).expect("removed");
    let (is_good, text) = run(&["calibrate", "evaluate", "--out", out_text], |_| true);
    assert!(is_good, "{text}");
    check(&std::fs::read_to_string(&file).expect("a calibration"));
    let report = std::fs::read_to_string(out.join("calibration.html")).expect("a report");
    assert!(
        report.contains("Calibration of a right insole") && report.contains("the later reading differs by +4.0 %"),
        "the report has the hysteresis"
    );

    let (is_good, text) = run(&["insole", "calibrate", file.to_str().expect("a path"), "--tcp", &address], |_| true);
    assert!(is_good, "{text}");
    let (_, text) = run(&["insole", "show", "--tcp", &address], |_| true);
    assert!(text.contains("\ncalibration ") && !text.contains("calibration: none"), "{text}");
}

#[test]
fn plateaus_that_cannot_be_read_or_do_not_suffice_are_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().to_str().expect("a path");
    let refused = |content: &str| {
        std::fs::write(folder.path().join("plateaus.json"), content).expect("written");
        let (is_good, text) = run(&["calibrate", "evaluate", "--out", out], |_| true);
        assert!(!is_good && text.contains("plateaus.json"), "{text}");
        text
    };
    assert!(refused("{").contains("EOF"));
    let head = r#""side":"Left","serial_number":"","layout_id":1,"law":{"full_kpa":1000.0,"exponent":0.8}"#;
    let cell = r#""cells":[{"x_mm":0.0,"y_mm":0.0,"area_mm2":60.0}]"#;
    assert!(refused(&format!(r#"{{"version":2,{head},{cell},"plateaus":[]}}"#)).contains("version 2"));
    assert!(refused(&format!(r#"{{"version":1,{head},{cell},"plateaus":[]}}"#)).contains("no plateau of 0 kPa"));
    let plateau = r#"{"pressure_kpa":-1.0,"frames":3,"codes":[5.0],"changes":[0.0]}"#;
    assert!(refused(&format!(r#"{{"version":1,{head},{cell},"plateaus":[{plateau}]}}"#)).contains("plateau 0: -1 kPa"));
    let plateau = r#"{"pressure_kpa":0.0,"frames":3,"codes":[],"changes":[]}"#;
    assert!(refused(&format!(r#"{{"version":1,{head},{cell},"plateaus":[{plateau}]}}"#)).contains("each of 1 cells"));
}
