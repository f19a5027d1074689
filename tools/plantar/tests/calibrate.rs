//! Drives `plantar calibrate` with an emulated insole under an even pressure. Its cells have known gains and zeros.

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

/// Runs the command, and passes each line of its output to `respond`, which returns what to type, or `None` to close the standard
/// input. Returns the exit status of the command, and its output.
fn run(arguments: &[&str], mut respond: impl FnMut(&str) -> Option<&'static str>) -> (Option<i32>, String) {
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
        match (respond(&line), &mut keys) {
            (Some(typed), Some(keys)) => keys.write_all(typed.as_bytes()).expect("the program reads its keys"),
            _ => keys = None,
        }
        text += &line;
        text.push('\n');
    }
    let output = child.wait_with_output().expect("the program ends");
    (output.status.code(), text + &String::from_utf8_lossy(&output.stderr))
}

/// The answer to a line of the output of `plantar calibrate measure`, if the device obeys each question: Enter.
fn obey(line: &str, bladder: &Bladder) -> Option<&'static str> {
    if line.contains("remove all load") {
        bladder.set(0.0, 0);
    } else if let Some((_, rest)) = line.split_once(": set ") {
        bladder.set(rest.split(' ').next()?.parse().expect("a pressure"), 0);
    }
    Some(if line.contains("press Enter") { "\n" } else { "" })
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_insole_is_calibrated_although_the_measurement_is_interrupted() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("calibration");
    let out_text = out.to_str().expect("a path");
    let bladder = Bladder::default();
    let (_board, address) = board(&bladder);
    let silent = |_: &str| Some("");
    let measured = |pressures: &str, respond: &mut dyn FnMut(&str) -> Option<&'static str>| {
        run(&["calibrate", "measure", "--pressures", pressures, "--out", out_text, "--tcp", &address], respond)
    };

    // Pressures that cannot be evaluated are refused before anything is measured, and so is an insole that cannot be identified.
    let (status, text) = measured("50,100", &mut |_| Some(""));
    assert!(status == Some(1) && text.contains("give 0 kPa") && !out.exists(), "{text}");
    let (status, text) = measured("0,0.5,1.0", &mut |_| Some(""));
    assert!(status == Some(2) && text.contains("0, or 1 to 3000"), "{text}");
    let (status, text) = measured("0,50,100", &mut |_| Some(""));
    assert!(status == Some(1) && text.contains("plantar insole name"), "{text}");
    let (status, text) = run(&["insole", "name", "--serial-number", "P-0001", "--tcp", &address], silent);
    assert_eq!(status, Some(0), "{text}");

    // At the first attempt, the pressure of the second plateau still rises. A line that is typed before a question does not
    // answer it. The gauge shows another pressure than the one that was asked for. Then the standard input ends.
    let mut attempts = 0;
    let (status, text) = measured("0,50,200,50,0", &mut |line: &str| {
        if line.contains("set 200 kPa") {
            return None;
        }
        if line.contains("set 50 kPa") {
            attempts += 1;
            bladder.set(52.0, if attempts == 1 { 200 } else { 0 });
            return Some("52\n");
        }
        // Enter, typed twice.
        Some(if line.contains("press Enter") { "\n\n" } else { "" })
    });
    assert!(text.contains("the reading changed by +") && attempts == 2, "{text}");
    assert!(status == Some(1) && text.contains("plateau 3 of 5: the plateaus before it are stored"), "{text}");

    let (status, text) = measured("0,100,200", &mut |_| Some(""));
    assert!(status == Some(1) && text.contains("[0.0, 50.0] kPa, with which --pressures must begin"), "{text}");

    // The third plateau is repeated once, because the pressure was wrong. On the way back, the sheet reads 4 % more.
    let mut asked_for_200 = 0;
    let (status, text) = measured("0,50,200,50,0", &mut |line: &str| {
        let answer = obey(line, &bladder);
        if line.contains("set 200 kPa") {
            asked_for_200 += 1;
            bladder.set(if asked_for_200 == 1 { 250.0 } else { 200.0 }, 0);
        } else if line.contains("set 50 kPa") {
            bladder.set(52.0, 0);
            if asked_for_200 == 1 {
                return Some("r\n");
            }
        }
        answer
    });
    assert!(text.contains("2 of 5 plateaus are measured already") && asked_for_200 == 2, "{text}");
    assert!(text.contains("hysteresis: at 50 kPa, the reading after higher pressures differs by +4.0 %"), "{text}");
    assert_eq!(status, Some(0), "{text}");

    let check = |text: &str| {
        let lines: Vec<&str> = text.lines().skip(1).collect();
        assert_eq!(lines.len(), 240);
        // At one of two levels, the mean of a plateau that reads the gauge's pressure and one that reads 4 % more.
        let expected = |cell: usize| gain(cell) / 1.04f64.powf(0.25);
        for (cell, line) in lines.iter().enumerate() {
            let fields: Vec<f64> = line.split(',').map(|field| field.parse().expect("a number")).collect();
            assert_eq!(fields[1], f64::from(zero(cell)), "the zero of cell {cell}");
            let error = fields[2] / expected(cell) - 1.0;
            assert!(error.abs() < 0.002, "cell {cell}: {} of {:.4}", fields[2], expected(cell));
        }
    };
    let file = out.join("calibration.csv");
    check(&std::fs::read_to_string(&file).expect("a calibration"));
    std::fs::remove_file(&file).expect("removed");

    // When all plateaus are measured, the command only evaluates them again.
    let (status, text) = measured("0,50,200,50,0", &mut |_| Some(""));
    assert!(status == Some(0) && !text.contains("measuring"), "{text}");
    check(&std::fs::read_to_string(&file).expect("a calibration"));
    let report = std::fs::read_to_string(out.join("calibration.html")).expect("a report");
    assert!(report.contains("Calibration of a right insole") && report.contains("Insole P-0001"));
    assert!(report.contains("the reading after higher pressures differs by +4.0 %"));

    // The calibration is accepted by this insole only.
    let plateaus = out.join("plateaus.json");
    let content = std::fs::read_to_string(&plateaus).expect("plateaus");
    std::fs::write(&plateaus, content.replace("P-0001", "P-0002")).expect("written");
    let store = ["insole", "calibrate", file.to_str().expect("a path"), "--tcp", &address];
    let (status, text) = run(&store, silent);
    assert!(status == Some(1) && text.contains("that of the right insole P-0002, not of this one"), "{text}");
    let (status, text) = measured("0,50,200,50,0", &mut |_| Some(""));
    assert!(status == Some(1) && text.contains("the plateaus are those of the right insole P-0002"), "{text}");
    std::fs::write(&plateaus, content.replace("\"exponent\":0.8", "\"exponent\":0.9")).expect("written");
    let (status, text) = run(&store, silent);
    assert!(status == Some(1) && text.contains("another sensor law"), "{text}");
    std::fs::write(&plateaus, content).expect("written");
    let (status, text) = run(&store, silent);
    assert_eq!(status, Some(0), "{text}");
    let (_, text) = run(&["insole", "show", "--tcp", &address], silent);
    assert!(text.contains("\ncalibration ") && !text.contains("calibration: none"), "{text}");
}

/// A file of plateaus with the pressures of `plateaus`, kPa, and the codes above a zero of 6000 of all cells, the last of which
/// does not respond.
fn file(cells: usize, plateaus: &[(f64, f32)]) -> String {
    let cell = r#"{"x_mm":0.0,"y_mm":0.0,"area_mm2":60.0,"row_column":18}"#;
    let plateau = |(kpa, code): &(f64, f32)| {
        let mut codes = vec![(6000.0 + code).to_string(); cells];
        codes[cells - 1] = "6000".into();
        let zeros = vec!["0"; cells].join(",");
        format!(
            r#"{{"nominal_kpa":{kpa},"pressure_kpa":{kpa},"unix_s":0,"frames":3,"codes":[{}],"changes":[{zeros}]}}"#,
            codes.join(",")
        )
    };
    let plateaus: Vec<String> = plateaus.iter().map(plateau).collect();
    format!(
        r#"{{"version":1,"side":"Left","serial_number":"A","firmware":"1","note":"","law":{{"full_kpa":1000.0,"exponent":0.8}},"cells":[{}],"plateaus":[{}]}}"#,
        vec![cell; cells].join(","),
        plateaus.join(",")
    )
}

#[test]
fn implausible_pressures_and_cells_that_fail_are_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let evaluate = |content: &str| {
        std::fs::write(folder.path().join("plateaus.json"), content).expect("written");
        run(&["calibrate", "evaluate", "--out", folder.path().to_str().expect("a path")], |_| Some(""))
    };
    let code = |kpa: f64, exponent: f64| 65_520.0 * (kpa / 1000.0).powf(exponent) as f32;
    let sheet = |exponent: f64, stated: f64| {
        let plateau = |kpa: f64| (kpa * stated, code(kpa, exponent));
        file(12, &[(0.0, 0.0), plateau(25.0), plateau(100.0), plateau(400.0)])
    };
    // Texts of the file are printed on the terminal.
    for (text, other) in [("\"A\"", "\"\\u001b[2J\""), ("\"firmware\":\"1\"", "\"firmware\":\"\\u0007\"")] {
        let (status, text) = evaluate(&sheet(0.8, 1.0).replace(text, other));
        assert!(
            status == Some(1) && text.contains("not printable text") && !text.contains(['\u{1b}', '\u{7}']),
            "{text}"
        );
    }
    let (status, text) = evaluate(&sheet(0.8, 1.0));
    assert!(status == Some(3) && text.contains("no response at 25 kPa: cell 11 (row 1, column 2)"), "{text}");
    assert!(text.contains("store it with") && text.contains("fits this sheet"), "{text}");
    let (_, text) = evaluate(&sheet(0.8, 1.0 / 6.895));
    assert!(text.contains("0.15 times those of the built-in law: are they in kPa"), "{text}");
    let (status, text) = evaluate(&sheet(0.9, 1.0));
    assert!(status == Some(3) && text.contains("full_kpa 1000 and exponent 0.900"), "{text}");
    assert!(text.contains("zero of the gauge") && !text.contains("store it with"), "{text}");
    // All cells are at full scale at one of the pressures.
    let (_, text) =
        evaluate(&file(12, &[(0.0, 0.0), (25.0, code(25.0, 0.8)), (100.0, code(100.0, 0.8)), (900.0, 59_520.0)]));
    assert!(
        text.contains("not used: 11 cells are at full scale") && !text.contains("NaN") && !text.contains("inf"),
        "{text}"
    );
}

#[test]
fn plateaus_that_cannot_be_read_or_do_not_suffice_are_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = |content: &str, expected: &str| {
        std::fs::write(folder.path().join("plateaus.json"), content).expect("written");
        let out = folder.path().to_str().expect("a path");
        let (status, text) = run(&["calibrate", "evaluate", "--out", out], |_| Some(""));
        assert!(status == Some(1) && text.contains("plateaus.json") && text.contains(expected), "{text}");
    };
    refused("{", "EOF");
    let good = file(2, &[(0.0, 0.0), (50.0, 6000.0), (100.0, 10_000.0)]);
    refused(&good.replace("\"version\":1", "\"version\":2"), "version 2");
    refused(&good.replace("\"frames\":3", "\"frames\":2"), "plateau 1: 2 frames");
    refused(&good.replace("pressure_kpa\":50", "pressure_kpa\":-1"), "plateau 2: -1 kPa");
    refused(&good.replace("pressure_kpa\":50", "pressure_kpa\":0"), "plateau 2: one pressure is 0");
    refused(&good.replace("\"codes\":[6000,", "\"codes\":["), "plateau 1: not a code and a change for each of 2 cells");
    refused(&good.replace("\"area_mm2\":60.0", "\"area_mm2\":-5"), "its area is not");
    refused(&file(2, &[(50.0, 6000.0)]), "no plateau of 0 kPa");
    refused(&file(2, &[(0.0, 0.0); 101]), "101 plateaus");
}
