//! Small exports that could be imported with wrong forces, or with a part of their data: they are refused, or imported with a
//! remark.

mod common;

use common::{assert_message, parse};
use plantar::Side;
use recording::{Format, Recording, pedar};

/// A geometry of two pedar sensors of each foot.
const GEOMETRY: &str = "side,sensor,area_mm2,x1_mm,y1_mm,x2_mm,y2_mm,x3_mm,y3_mm,x4_mm,y4_mm\n\
    right,1,100,100,10,110,10,110,20,100,20\nright,2,100,110,10,120,10,120,20,110,20\n\
    left,1,100,50,10,40,10,40,20,50,20\nleft,2,100,40,10,30,10,30,20,40,20\n";

/// Imports the left foot of a pedar export with these lines before and after the line that names the sensors.
fn pedar(header: &str, frames: &str) -> Result<Recording, String> {
    let asc = format!("{header}\ntime[secs]\t1\t2\t1\t2\n{frames}");
    pedar::parse(asc.as_bytes(), GEOMETRY.as_bytes(), Side::Left).map_err(|error| error.to_string())
}

#[track_caller]
fn assert_words(result: Result<Recording, String>, words: &[&str]) {
    let message = result.expect_err("the file is refused");
    for word in words {
        assert!(message.contains(word), "`{word}` is not in: {message}");
    }
}

/// A pliance mat of six rows of two sensors with a side of 2 cm. The load moves over the rows. `field` is the text of the
/// pressure of the sensors in the row under its centre; those in the adjacent rows have 250.
fn pliance(header: &str, field: &str) -> String {
    let names: Vec<_> = (1..=12).map(|sensor| sensor.to_string()).collect();
    let mut text = format!("{header}\ntime[secs] {}\n", names.join(" "));
    for frame in 0..12 {
        let value = |sensor: usize| match (5 - sensor / 2).abs_diff(frame / 2) {
            0 => field.to_owned(),
            1 => "250".to_owned(),
            _ => "0".to_owned(),
        };
        text += &format!("0.{frame:02} {}\n", (0..12).map(value).collect::<Vec<_>>().join(" "));
    }
    for (corner, right, down) in [(1, 0, 0), (2, 2, 0), (3, 2, 2), (4, 0, 2)] {
        let x: Vec<_> = (0..12).map(|sensor| (sensor % 2 * 2 + right).to_string()).collect();
        let y: Vec<_> = (0..12).map(|sensor| (14 - sensor / 2 * 2 - down).to_string()).collect();
        text += &format!("x[{corner}] {}\ny[{corner}] {}\n", x.join(" "), y.join(" "));
    }
    text
}

/// A Tekscan export of a left F-Scan insole, with two frames, each of which has these rows.
fn tekscan(rows: &[&str]) -> String {
    let columns = rows[0].split(if rows[0].contains(';') { ';' } else { ',' }).count();
    let mut text = format!(
        "DATA_TYPE MOVIE\nFILENAME C:\\walkL.fsx\nSENSOR_TYPE FSCAN\nROWS {}\nCOLS {columns}\nROW_SPACING 10 mm\n\
         COL_SPACING 10 mm\nSECONDS_PER_FRAME 0.01\nSATURATION_PRESSURE 500.0 KPa\nUNITS KPa\nASCII_DATA @@\n",
        rows.len()
    );
    for frame in 1..=2 {
        text += &format!("Frame {frame}\n{}\n", rows.join("\n"));
    }
    text
}

/// A loadsol export with columns of these names for one insole.
fn loadsol(names: &[&str], rows: &[&[&str]]) -> String {
    let mut text = format!("walk\n\t{}\n[sec]{}\n", names.join("\t"), "\t[N]".repeat(names.len()));
    for (i, row) in rows.iter().enumerate() {
        text += &format!("0.0{i}\t{}\n", row.join("\t"));
    }
    text
}

#[test]
fn thousands_separators_are_refused_with_their_line() {
    for thousand in ["1,028", "1.028"] {
        let frames = format!("0.010\t0\t750\t1\t2\n0.020\t{thousand}\t0\t3\t4\n0.030\t0\t0\t5\t6\n");
        assert_words(pedar("", &frames), &["measurement.asc:4: ", thousand, "thousands"]);
        let on_mat = pliance("pressure values in mmHg", thousand);
        assert_message(parse(Format::Pliance, "a.asc", on_mat.as_bytes(), None), "a.asc:3: ", &[thousand, "thousands"]);
        let row = ["200", "B", thousand].join(";");
        let plate = tekscan(&[&row, "0;0;0"]);
        assert_message(parse(Format::Tekscan, "a.asf", plate.as_bytes(), None), "a.asf:13: ", &[thousand, "thousands"]);
        let zones = ["S1-L:heel", "S1-L:medial", "S1-L:lateral"];
        let forces = loadsol(&zones, &[&["750", "0", "0"], &[thousand, "0", "0"], &["0", "0", "0"]]);
        assert_message(parse(Format::Loadsol, "a.txt", forces.as_bytes(), None), "a.txt:5: ", &[thousand, "thousands"]);
        let xsensor = format!(
            "Units:;mmHg\nFRAME;1\nTime;08:00:00.0\nSENSOR;A-LF\nRows;1\nColumns;2\nSensel Width (cm);1\n\
             Sensel Height (cm);1\nSENSELS\n{thousand};300\n"
        );
        let result = parse(Format::Xsensor, "a.csv", xsensor.as_bytes(), None);
        assert_message(result, "a.csv:10: ", &[thousand, "thousands"]);
    }
}

#[test]
fn three_decimals_are_read_as_such() {
    let consistent = pedar("", "0.010\t1.028\t750.000\t1\t2\n0.020\t1.5\t0\t3\t4\n0.030\t0\t0\t5\t6\n").unwrap();
    assert_eq!(consistent.pressure_kpa[..2], [1.028, 750.0]);
    // Times with three decimals are no evidence.
    let whole = pedar("", "1.010\t100\t750\t1\t2\n1.020\t200\t0\t3\t4\n1.030\t0\t0\t5\t6\n").unwrap();
    assert_eq!(whole.pressure_kpa[..2], [100.0, 750.0]);
}

#[test]
fn a_stated_unit_is_used_in_all_wordings() {
    let frames = "0.01\t1\t2\t1\t2\n0.02\t3\t4\t3\t4\n0.03\t5\t6\t5\t6\n";
    for header in [
        "\tpressure values in N/cm2",
        "  Pressure Values in [N/cm²]",
        "Druckwerte in N/cm²",
        "Druck [N/cm2]",
        "file name: a.sol\tPRESSURE VALUES IN N/cm2",
        "pressure unit: N/cm2",
        "pressure values in: N/cm2",
    ] {
        let recording = pedar(header, frames).unwrap();
        assert_eq!(recording.pressure_kpa[..2], [10.0, 20.0], "{header}");
        assert!(!recording.source.contains("no unit"), "{header}");
        let text = pliance(header, "20.5");
        assert_eq!(Format::recognise(text.as_bytes(), "a.asc".as_ref()).unwrap(), Format::Pliance);
        let export = parse(Format::Pliance, "a.asc", text.as_bytes(), Some(Side::Left)).unwrap();
        assert!(export.feet[0].pressure_kpa.contains(&205.0), "{header}");
        assert!(!export.feet[0].source.contains("no unit"), "{header}");
    }
    assert_eq!(pedar("comment: sushi bar", frames).unwrap().pressure_kpa[..2], [1.0, 2.0]);
    assert_words(pedar("pressure values in kPa\nDruckwerte in N/cm2", frames), &["measurement.asc:2: ", "contradicts"]);
    let unstated = parse(Format::Pliance, "a.asc", pliance("", "20.5").as_bytes(), Some(Side::Left)).unwrap();
    assert!(unstated.feet[0].source.contains("no unit: kPa is assumed"), "{}", unstated.feet[0].source);
}

#[test]
fn negative_pressures_are_read_as_zero_with_a_remark() {
    let remark = |row: &str| {
        let text = tekscan(&[row, "10,10,10", "10,10,10", "10,10,10", "10,10,10", "10,10,10", "10,10,10", "10,10,10"]);
        let export = parse(Format::Tekscan, "walkL.asf", text.as_bytes(), None).unwrap();
        export.remarks.into_iter().find(|remark| remark.contains("negative pressures"))
    };
    assert_eq!(remark("0,10,10"), None);
    // The export has two frames.
    let expected = "Left foot: negative pressures that were read as 0, in all frames together: 4. \
                    The lowest one is -4.00 kPa.";
    assert_eq!(remark("-4,10,-2.5").as_deref(), Some(expected));
    let small = remark("-0.004,10,10").unwrap();
    assert!(small.ends_with("The lowest one is -0.00400 kPa."), "{small}");
}

#[test]
fn a_contact_on_a_mat_that_is_cut_off_leads_to_a_remark() {
    let export = parse(Format::Pliance, "a.asc", pliance("", "20.5").as_bytes(), Some(Side::Left)).unwrap();
    for which in ["first frame carries", "last frame carries"] {
        assert!(export.remarks.iter().any(|remark| remark.contains(which)), "{:?}", export.remarks);
    }
}

#[test]
fn a_contact_on_a_tekscan_plate_that_is_cut_off_leads_to_a_remark() {
    // The footprint is longer than wide, and carries load in both frames.
    let insole =
        tekscan(&["10,10,10", "10,10,10", "10,10,10", "10,10,10", "10,10,10", "10,10,10", "10,10,10", "10,10,10"]);
    let plate = insole.replace("SENSOR_TYPE FSCAN", "SENSOR_TYPE 5101");
    let remarks = |text: &str| {
        let export = parse(Format::Tekscan, "walkL.asf", text.as_bytes(), Some(Side::Left)).unwrap();
        export.remarks.iter().filter(|remark| remark.contains("frame carries")).count()
    };
    assert_eq!((remarks(&plate), remarks(&insole)), (2, 0));
}

/// On 3 x 8 cells of 100 mm2, 333.3 kPa are 800 N, 50 kPa 120 N, and 25 kPa 60 N.
#[test]
fn a_contact_on_a_plate_that_cannot_become_a_step_leads_to_a_remark() {
    let frame = |kpa: &str| [[kpa; 3].join(",").as_str(); 8].join("\n");
    let text = tekscan(&["0,0,0"; 8]).replace("SENSOR_TYPE FSCAN", "SENSOR_TYPE 5101");
    let (header, _) = text.split_once("Frame 1").expect("a frame");
    let remarks = |first: &str, last: &str| {
        let frames = [first, "333.3", last].map(frame);
        let frames: String = (1..).zip(frames).map(|(i, frame)| format!("Frame {i}\n{frame}\n")).collect();
        let text = format!("{header}{frames}");
        let export = parse(Format::Tekscan, "step.asf", text.as_bytes(), Some(Side::Left)).unwrap();
        export.remarks.into_iter().filter(|remark| remark.contains("frame carries")).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(remarks("25", "25"), "");
    assert_eq!(
        remarks("50", "25"),
        "Left foot: the first frame carries 120 N: from 70 N on, the contact does not become a step, because its heel \
         strike is missing; export unloaded frames before it."
    );
    assert_eq!(
        remarks("25", "50"),
        "Left foot: the last frame carries 120 N: from 70 N on, the contact does not become a step, because its toe \
         off is missing; export unloaded frames after it."
    );
}

#[test]
fn forces_of_a_foot_that_are_no_zone_are_refused_and_the_total_is_compared() {
    let rows: &[&[&str]] = &[&["300.5", "20", "30", "350.5"], &["310.5", "20", "30", "360.5"], &["1", "0", "0", "1"]];
    let import = |names: &[&str]| parse(Format::Loadsol, "a.txt", loadsol(names, rows).as_bytes(), None);
    let export = import(&["S1-L:heel", "S1-L:medial", "S1-L:lateral", "S1-L"]).unwrap();
    assert!(export.remarks[0].contains("+0.00 %"), "{:?}", export.remarks);
    let total = loadsol(&["S1-L:heel", "S1-L:medial", "S1-L:lateral", "S1-L"], rows).replace("350.5", "701");
    let export = parse(Format::Loadsol, "a.txt", total.as_bytes(), None).unwrap();
    assert!(export.remarks[0].contains("50.00 %"), "{:?}", export.remarks);
    for name in ["S1-L:Ferse", "Ferse-L", "S1-L:heel medial"] {
        assert_message(import(&[name, "S1-L:medial", "S1-L:lateral", "S1-L"]), "a.txt:2: ", &[name, "zone"]);
    }
    // Without this error, the left foot would be missing in the import of the right one.
    let no_left_zone = import(&["S1-L:Ferse", "S1-R:heel", "S1-R:medial", "S1-R:lateral"]);
    assert_message(no_left_zone, "a.txt:2: ", &["S1-L:Ferse", "left foot", "zone"]);
    let two_heels = import(&["S1-L:heel", "S1-L:medial", "S1-L:lateral", "S2-L:heel"]);
    assert_message(two_heels, "a.txt:2: ", &["S2-L:heel", "second heel"]);
}

#[test]
fn the_letter_next_to_the_zone_states_the_foot() {
    let rows: &[&[&str]] = &[&["300.5", "20", "400"], &["310.5", "20", "400"], &["1", "0", "0"]];
    let text = loadsol(&["R-Meyer-L:heel", "R-Meyer-L:medial", "R-Meyer-R:heel"], rows);
    let export = parse(Format::Loadsol, "a.txt", text.as_bytes(), None).unwrap();
    assert_eq!(
        export.feet.iter().map(|foot| (foot.side, foot.cells())).collect::<Vec<_>>(),
        [(Side::Left, 2), (Side::Right, 1)]
    );
    let text = loadsol(&["L heel R", "R medial", "R lateral"], rows);
    assert_message(parse(Format::Loadsol, "a.txt", text.as_bytes(), None), "a.txt:2: ", &["L heel R", "both feet"]);
}

#[test]
fn loadsol_exports_in_another_unit_or_with_other_separators_are_refused_with_the_reason() {
    let text = loadsol(&["S1-L:heel", "S1-L:medial"], &[&["300.5", "20"], &["310.5", "20"]]);
    for (changed, place, words) in [
        (text.replace("[N]", "[lbf]"), "a.txt:2: ", ["[lbf]", "in N"]),
        (text.replace("[N]", "[kN]"), "a.txt:2: ", ["[kn]", "in N"]),
        (text.replace('\t', ";"), "a.txt: ", ["`;`", "tabs"]),
    ] {
        assert_eq!(Format::recognise(changed.as_bytes(), "a.txt".as_ref()).unwrap(), Format::Loadsol);
        assert_message(parse(Format::Loadsol, "a.txt", changed.as_bytes(), None), place, &words);
    }
}

#[test]
fn a_second_measurement_in_a_file_is_refused_with_its_line() {
    let frames = "0.01\t1\t2\t1\t2\n0.02\t3\t4\t3\t4\n0.03\t5\t6\t5\t6\n";
    let second = format!("{frames}file name: b.sol date/time\n\ntime[secs]\t1\t2\t1\t2\n{frames}");
    assert_words(pedar("pressure values in kPa", &second), &["measurement.asc:8: ", "another measurement"]);
    let zones = loadsol(&["S1-L:heel", "S1-L:medial"], &[&["300.5", "20"], &["310.5", "20"]]);
    let twice = format!("{zones}{zones}");
    assert_message(parse(Format::Loadsol, "a.txt", twice.as_bytes(), None), "a.txt:8: ", &["another measurement"]);
    let plate = tekscan(&["200,7,9", "0,0,0"]);
    let twice = format!("{plate}@@\n{plate}");
    assert_message(parse(Format::Tekscan, "a.asf", twice.as_bytes(), None), "a.asf:19: ", &["another measurement"]);
    let moticon = "# time\tleft pressure 1[N/cm²]\tleft total force[N]\n0.00\t1\t2\n";
    let twice = format!("{moticon}{moticon}");
    assert_message(parse(Format::Moticon, "a.txt", twice.as_bytes(), None), "a.txt:3: ", &["another measurement"]);
}

#[test]
fn contradicting_names_of_a_tekscan_export_are_refused_unless_the_foot_is_stated() {
    let text = tekscan(&["200,7,9", "0,0,0"]);
    let import = |side| parse(Format::Tekscan, "walkR.asf", text.as_bytes(), side);
    assert_message(import(None), "walkR.asf: ", &["walkL.fsx", "`walkR.asf`", "--side"]);
    assert_eq!(import(Some(Side::Right)).unwrap().feet[0].side, Side::Right);
}

#[test]
fn saturated_cells_lead_to_a_remark() {
    let import = |text: &str| parse(Format::Tekscan, "walk.asf", text.as_bytes(), None).unwrap().remarks.join(" ");
    let remarks = import(&tekscan(&["500,499.9,9", "0,0,3"]));
    assert!(remarks.contains("SATURATION_PRESSURE, 500 kPa: 2, in 2 frames"), "{remarks}");
    assert!(!import(&tekscan(&["490,7,9", "0,0,3"])).contains("SATURATION"));
}

/// The cells are squares, so a foot of 18 columns is less than twice as long as wide with 24 rows, and longer with 48 rows.
#[test]
fn a_footprint_less_than_twice_as_long_as_wide_leads_to_a_remark() {
    let remarks = |rows: usize| {
        let row = ["100"; 18].join(",");
        let text = tekscan(&vec![row.as_str(); rows]);
        parse(Format::Tekscan, "walk.asf", text.as_bytes(), None).unwrap().remarks.join(" ")
    };
    let forefoot = remarks(24);
    assert!(forefoot.contains("regions are those of a whole foot"), "{forefoot}");
    assert!(!remarks(48).contains("whole foot"));
}

#[test]
fn values_without_a_known_separator_are_refused_with_the_reason_and_one_at_the_end_is_ignored() {
    let text = tekscan(&["200,7,9", "0,0,1"]);
    let import = |text: &str| parse(Format::Tekscan, "walk.asf", text.as_bytes(), None);
    assert_message(import(&text.replace("200,7,9", "200 7 9")), "walk.asf:13: ", &["commas, semicolons or tabs"]);
    for (separator, end) in [(",", ","), (";", ";"), ("\t", "\t")] {
        let with_end = text.replace("200,7,9", &format!("200,7,9{end}")).replace("0,0,1", &format!("0,0,1{end}"));
        assert_eq!(import(&with_end.replace(',', separator)).unwrap().feet, import(&text).unwrap().feet);
    }
}

#[test]
fn a_footscan_header_with_a_unit_of_pressure_is_refused() {
    for header in ["Pressure in N/cm2\nRight foot data", "Right foot data\nDruck [kPa]"] {
        let text = format!("{header}\nFrame 0 (0.00 ms)\n1\t1\n1\t1\nFrame 1 (2.00 ms)\n1\t1\n1\t1\n");
        let line = if header.starts_with("Pressure") { "a.txt:1: " } else { "a.txt:2: " };
        assert_message(parse(Format::Footscan, "a.txt", text.as_bytes(), None), line, &["forces in N"]);
    }
}

#[test]
fn an_emed_page_with_two_pictures_is_refused_with_the_line_of_the_second() {
    let page = |picture: usize| {
        format!(
            "\tTime/picture:10.0 ms\n\tSensor size: 2.000x2.000 cm\n\tPict-No.: {picture}\n\t1\t2\tForce\n\
             1\t100.00\t100.00\t80.00\n2\t100.00\t100.00\t80.00\nForce\t80.00\t80.00\t160.00\n"
        )
    };
    let text = format!("{}{}", page(1), page(2));
    assert_message(
        parse(Format::Emed, "a.lst", text.as_bytes(), None),
        "a.lst:10: ",
        &["second picture", "form feeds"],
    );
}

#[test]
fn compressed_files_and_a_geometry_of_the_other_foot_are_named_as_such() {
    for (bytes, word) in [(&b"\x1f\x8b\x08\x00"[..], "gzip"), (b"PK\x03\x04\x14\x00", "zip")] {
        let error = Format::recognise(bytes, "a.asf".as_ref()).unwrap_err().to_string();
        assert!(error.contains(word) && error.contains("unpack"), "{error}");
    }
    for empty in ["", "\n"] {
        let error = recording::csv::parse(empty.as_bytes(), &b"t_s,c0\n"[..], Side::Left).unwrap_err().to_string();
        assert_eq!(error, "layout.csv:1: the file is empty; export or write it again");
    }
    let right_only: String = GEOMETRY.lines().take(3).map(|line| format!("{line}\n")).collect();
    let asc = "time[secs]\t1\t2\n0.01\t1\t2\n0.02\t3\t4\n";
    let error = pedar::parse(asc.as_bytes(), right_only.as_bytes(), Side::Left).unwrap_err().to_string();
    assert!(error.contains("no sensor of the left foot"), "{error}");
}

#[test]
fn other_separators_are_named_as_such() {
    let header = "time[secs];1;2;1;2\n0.01;1;2;1;2\n";
    let error = pedar::parse(header.as_bytes(), GEOMETRY.as_bytes(), Side::Left).unwrap_err().to_string();
    assert!(error.starts_with("measurement.asc:1: `;` separates"), "{error}");
    let mat = pliance("", "20.5").replace("time[secs] 1 2", "time[secs];1;2");
    assert_message(parse(Format::Pliance, "a.asc", mat.as_bytes(), None), "a.asc:2: ", &["`;` separates"]);
    let insole = "# time;left pressure 1[N/cm²];left total force[N]\n0.00;1;2\n";
    assert_message(parse(Format::Moticon, "a.txt", insole.as_bytes(), None), "a.txt:1: ", &["tabs"]);
}

#[test]
fn a_long_period_is_stated_as_a_decimal_number() {
    let text = tekscan(&["200,7,9", "0,0,1"]).replace("PER_FRAME 0.01", "PER_FRAME 32");
    assert_message(parse(Format::Tekscan, "a.asf", text.as_bytes(), None), "a.asf:8: ", &["every 32 s"]);
}
