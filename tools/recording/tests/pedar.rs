//! The import of small files in the format of pedar, and of a real measurement, which is not part of this repository.

mod common;

use plantar::Side;
use recording::{Recording, Result, Span, pedar};
use tempfile::TempDir;

const GEOMETRY: &str = "side,sensor,area_mm2,x1_mm,y1_mm,x2_mm,y2_mm,x3_mm,y3_mm,x4_mm,y4_mm\n\
    right,1,100,100,10,110,10,110,20,100,20\n\
    right,2,100,110,10,120,10,120,20,110,20\n\
    left,1,100,50,10,40,10,40,20,50,20\n\
    left,2,100,40,10,30,10,30,20,40,20\n";
const ASC: &str = "file name:\ttest\npressure values in  kPa\n\n\
    time[secs]\t1\t2\t1\t2\n0.01\t1\t2\t3\t4\n0.02\t5\t6\t7\t8\n0.03\t9\t10\t11\t12\n";

fn import(asc: &str, geometry: &str, side: Side) -> Result<Recording> {
    let folder = TempDir::new().unwrap();
    let paths = ["walk.asc", "geometry.csv"].map(|name| folder.path().join(name));
    std::fs::write(&paths[0], asc).unwrap();
    std::fs::write(&paths[1], geometry).unwrap();
    pedar::import(&paths[0], &paths[1], side, &mut |_, _| {})
}

#[test]
fn each_foot_is_imported_from_its_own_columns_with_x_to_the_lateral_side() {
    let left = import(ASC, GEOMETRY, Side::Left).unwrap();
    let right = import(ASC, GEOMETRY, Side::Right).unwrap();
    assert_eq!(left.pressure_kpa, [1.0, 2.0, 5.0, 6.0, 9.0, 10.0]);
    assert_eq!(right.pressure_kpa, [3.0, 4.0, 7.0, 8.0, 11.0, 12.0]);
    for foot in [left, right] {
        let centres: Vec<_> = foot.layout.cells.iter().map(|c| (c.x_mm, c.y_mm)).collect();
        assert_eq!(centres, [(5.0, 5.0), (15.0, 5.0)]);
    }
}

#[test]
fn variants_of_the_export_yield_the_same_pressures() {
    let usual = import(ASC, GEOMETRY, Side::Right).unwrap();
    let commas = ASC.replace("0.0", "0,0").replace("\t1\t2\t3\t4\n", "\t1,0\t2,0\t3,0\t4,0\n");
    let newtons = ASC.replace("kPa", "N/cm²").replace("\t3\t4\n", "\t0.3\t0.4\n").replace("\t7\t8\n", "\t0.7\t0.8\n");
    let newtons = newtons.replace("\t11\t12\n", "\t1.1\t1.2\n");
    let summaries = format!("{ASC}MVP\t1\t2\t3\t4\nMPP\t1\t2\t3\t4\n");
    let one_foot = "time[secs]\t1\t2\n0.01\t3\t4\n0.02\t7\t8\n0.03\t11\t12\n";
    for (asc, tolerance) in [(&*commas, 0.0), (&newtons, 1e-5), (&summaries, 0.0), (one_foot, 0.0)] {
        let variant = import(asc, GEOMETRY, Side::Right).unwrap();
        assert_eq!((&variant.layout, &variant.t_s), (&usual.layout, &usual.t_s), "{asc}");
        for (a, b) in variant.pressure_kpa.iter().zip(&usual.pressure_kpa) {
            assert!((a - b).abs() <= tolerance * b, "{a} {b} {asc}");
        }
    }
    let latin_1: Vec<u8> = newtons.chars().map(|c| c as u8).collect();
    assert_eq!(pedar::parse(&latin_1, GEOMETRY.as_bytes(), Side::Right).unwrap().frames(), 3);
}

#[test]
fn the_mask_definition_divides_the_sensors_between_the_feet() {
    // The numbers continue to increase in the second foot.
    let both = "left insole: 1\nright insole: 2\ntime[secs]\t1\t2\n0.01\t1\t2\n0.02\t3\t4\n0.03\t5\t6\n";
    assert_eq!(import(both, GEOMETRY, Side::Left).unwrap().pressure_kpa, [1.0, 3.0, 5.0]);
    assert_eq!(import(both, GEOMETRY, Side::Right).unwrap().pressure_kpa, [2.0, 4.0, 6.0]);
    let right = both.replace("insole: 1\n", "insole:\n").replace("insole: 2\n", "insole: 1,2,\n");
    assert_eq!(import(&right, GEOMETRY, Side::Right).unwrap().cells(), 2);
    let error = import(&right, GEOMETRY, Side::Left).unwrap_err().to_string();
    assert!(error.contains("walk.asc:3: ") && error.contains("--side right"), "{error}");
}

#[test]
fn negative_pressures_are_read_as_zero_with_a_remark_of_their_foot() {
    let asc = ASC.replace("kPa", "N/cm2").replace("\t7\t8\n", "\t-0.7\t-1.25\n");
    let right = import(&asc, GEOMETRY, Side::Right).unwrap();
    assert_eq!(right.pressure_kpa[2..4], [0.0, 0.0]);
    let counted =
        "Right foot: negative pressures that were read as 0, in all frames together: 2. The lowest one is -12.5 kPa.";
    assert!(right.source.contains(counted), "{}", right.source);
    let left = import(&asc, GEOMETRY, Side::Left).unwrap();
    assert!(!left.source.contains("negative"), "{}", left.source);
}

#[test]
fn semicolons_and_decimal_commas_in_the_geometry_yield_the_same_layout() {
    let decimal = GEOMETRY.replace("right,1,100,", "right,1,100.5,");
    let usual = import(ASC, &decimal, Side::Right).unwrap();
    assert_eq!(usual.layout.cells[0].area_mm2, 100.5);
    let with_commas = decimal.replace(',', ";").replace('.', ",");
    assert_eq!(import(ASC, &with_commas, Side::Right).unwrap(), usual);
}

#[test]
fn the_label_of_the_unit_may_have_capitals() {
    let newtons = ASC.replace("pressure values in  kPa", "Pressure values in N/cm2");
    let recording = import(&newtons, GEOMETRY, Side::Left).unwrap();
    assert_eq!(recording.pressure_kpa, [10.0, 20.0, 50.0, 60.0, 90.0, 100.0]);
    assert!(!recording.source.contains("no unit"), "{}", recording.source);
}

#[test]
fn sensors_that_a_mask_excluded_are_missing_in_the_layout() {
    let masked = "time[secs]\t2\t1\t2\n0.01\t2\t3\t4\n0.02\t6\t7\t8\n0.03\t10\t11\t12\n";
    let left = import(masked, GEOMETRY, Side::Left).unwrap();
    assert_eq!(left.pressure_kpa, [2.0, 6.0, 10.0]);
    assert_eq!((left.layout.cells[0].x_mm, left.layout.cells[0].y_mm), (15.0, 5.0));
    assert!(left.source.contains("1 sensor is not in the export") && left.source.contains("no unit: kPa is assumed"));
    assert_eq!(import(masked, GEOMETRY, Side::Right).unwrap().pressure_kpa, [3.0, 4.0, 7.0, 8.0, 11.0, 12.0]);
}

/// The frames of [`ASC`] end at 0.03 s.
#[test]
fn an_export_that_ends_before_its_stated_time_has_a_remark() {
    let folder = TempDir::new().unwrap();
    let paths = ["walk.asc", "geometry.csv"].map(|name| folder.path().join(name));
    std::fs::write(&paths[1], GEOMETRY).unwrap();
    for (total, is_cut_off) in [("0.030", false), ("0,040", false), ("15.050", true)] {
        let asc = format!("total time [secs]:  {total}\ttime per frame [secs]:  0.01\tscanning rate [Hz]: 100\n{ASC}");
        std::fs::write(&paths[0], asc).unwrap();
        let export =
            pedar::import_feet(&paths[0], &paths[1], &[Side::Left, Side::Right], Span::default(), &mut |_, _| {})
                .unwrap();
        let remarks = export.remarks.iter().filter(|remark| remark.contains("cut off"));
        assert_eq!(remarks.count(), usize::from(is_cut_off), "{total}: {:?}", export.remarks);
        for foot in &export.feet {
            let words = ["15.05 s, but the last frame is at 0.03 s", "cut off"];
            assert_eq!(words.iter().all(|word| foot.source.contains(word)), is_cut_off, "{}", foot.source);
        }
    }
}

/// The span does not hide that the export is cut off.
#[test]
fn a_span_applies_to_both_feet() {
    let folder = TempDir::new().unwrap();
    let paths = ["walk.asc", "geometry.csv"].map(|name| folder.path().join(name));
    std::fs::write(&paths[0], format!("total time [secs]:  15.05\n{ASC}")).unwrap();
    std::fs::write(&paths[1], GEOMETRY).unwrap();
    let import = |span| pedar::import_feet(&paths[0], &paths[1], &[Side::Left, Side::Right], span, &mut |_, _| {});
    let whole = import(Span::default()).unwrap();
    let export = import(Span { from_s: 0.02, ..Span::default() }).unwrap();
    for (foot, whole) in export.feet.iter().zip(&whole.feet) {
        let left_out = whole.t_s.iter().filter(|t_s| **t_s < 0.02).count();
        assert!(left_out > 0 && foot.frames() > 1);
        assert_eq!(foot.t_s, whole.t_s[left_out..]);
        assert_eq!(foot.pressure_kpa, whole.pressure_kpa[left_out * whole.cells()..]);
        let words = [&format!("Frames that were left out: {left_out}."), "cut off"];
        assert!(words.iter().all(|word| foot.source.contains(*word)), "{}", foot.source);
    }
    let error = import(Span { from_s: 1.0, ..Span::default() }).unwrap_err().to_string();
    assert!(error.contains("walk.asc: no frame from 1 s") && error.contains("to 0.03 s"), "{error}");
}

/// The geometry of all sensors with the size of the insole.
fn geometry_of(insole: &str) -> String {
    let lines = GEOMETRY.lines().enumerate().map(|(i, line)| match i {
        0 => format!("{line},insole\n"),
        _ => format!("{line},{insole}\n"),
    });
    lines.collect()
}

#[test]
fn a_geometry_of_another_insole_size_is_refused_and_an_unknown_size_has_a_remark() {
    let typed = format!("file name: a.sol\nsensor type:  y-1865l-1870r-pxf306 \n{ASC}");
    let folder = TempDir::new().unwrap();
    let paths = ["walk.asc", "geometry.csv"].map(|name| folder.path().join(name));
    let remarks = |asc: &str, geometry: &str| {
        std::fs::write(&paths[0], asc).unwrap();
        std::fs::write(&paths[1], geometry).unwrap();
        let export =
            pedar::import_feet(&paths[0], &paths[1], &[Side::Left, Side::Right], Span::default(), &mut |_, _| {})
                .unwrap();
        assert!(export.feet.iter().all(|foot| export.remarks.iter().all(|remark| foot.source.contains(remark))));
        export.remarks.join(" ")
    };
    assert_eq!(remarks(&typed, &geometry_of("Y")), "");
    let unknown = remarks(&typed, GEOMETRY);
    assert!(unknown.contains("insole size y") && unknown.contains("column insole"), "{unknown}");
    for geometry in [GEOMETRY, &geometry_of("y")] {
        let untyped = remarks(ASC, geometry);
        assert!(untyped.contains("no sensor type"), "{untyped}");
    }
    let foot = import(&typed, &geometry_of("y"), Side::Right).unwrap();
    assert_eq!(foot.layout.name, "pedar insole y, sensor type y-1865l-1870r-pxf306, 2 sensors");
    assert!(foot.source.contains("right insole, sensor type y-1865l-1870r-pxf306, geometry"), "{}", foot.source);
    let words = ["geometry.csv:2: ", "insole size `x`", "`y-1865l-1870r-pxf306`", "use the geometry of insole size y"];
    assert_refused(&typed, &geometry_of("x"), &words);
    assert_refused(&typed, &geometry_of(""), &["geometry.csv:2: ", "an empty field in column insole"]);
}

#[test]
fn the_source_states_the_time_of_the_measurement() {
    let timed = ASC.replace("test\n", "test.sol\tdate/time  25.04.23 10.49\n");
    let source = import(&timed, GEOMETRY, Side::Left).unwrap().source;
    assert!(source.contains("Measured at `25.04.23 10.49`."), "{source}");
    assert!(!import(ASC, GEOMETRY, Side::Left).unwrap().source.contains("Measured at"));
}

#[track_caller]
fn assert_refused(asc: &str, geometry: &str, expected: &[&str]) {
    let error = import(asc, geometry, Side::Right).unwrap_err().to_string();
    for part in expected {
        assert!(error.contains(part), "`{part}` not in: {error}");
    }
}

#[test]
fn the_error_for_an_invalid_measurement_names_the_line() {
    let refused = |from: &str, to: &str, expected: &[&str]| {
        assert_refused(&ASC.replace(from, to), GEOMETRY, expected);
    };
    refused("kPa", "N", &["walk.asc:2", "`N`", "export the measurement in kPa"]);
    refused("1\t2\t1\t2", "1\t2\t1\tx", &["walk.asc:4", "`x`"]);
    refused("1\t2\t1\t2", "1\t2\t3\t1\t2\t3", &["walk.asc:4", "geometry.csv"]);
    refused("time", "dime", &["walk.asc", "time[secs]", "ASCII"]);
    refused("\t7\t8", "\t7", &["walk.asc:6", "4 columns"]);
    refused("\t7\t8", "\t7\tNaN", &["walk.asc:6", "right 2", "finite"]);
    refused("\t7\t8", "\t7\t60000", &["walk.asc:6", "right 2", "60000 kPa", "0 to 50000 kPa"]);
    refused("\t7\t8", "\t7\t1,028.5", &["walk.asc:6", "`1,028.5`", "without thousands separators"]);
    refused("0.02", "0.01", &["walk.asc:6", "repeated"]);
    refused("0.03", "0.005", &["walk.asc:7", "backwards"]);
    refused("0.03\t9", "0.07\t9", &["walk.asc:7", "after the frame before"]);
}

#[test]
fn the_error_for_an_invalid_geometry_names_the_line() {
    let refused = |from: &str, to: &str, expected: &[&str]| {
        assert_refused(ASC, &GEOMETRY.replace(from, to), expected);
    };
    refused("area_mm2", "area", &["geometry.csv:1", "the header is side,sensor"]);
    refused(",", "\t", &["geometry.csv:1", "a tab separates the fields, expected `,`"]);
    refused("left,1", ",,,,,,,,,,\nleft,1", &["geometry.csv:4", "an empty field in column side", "fill the field"]);
    refused("right,1,100", "right,1,150", &["geometry.csv:2", "enclose 100"]);
    refused("right,1,100", "right,1,0", &["geometry.csv:2", "area 0"]);
    refused("right,2", "right,3", &["geometry.csv:3", "expected 2"]);
    refused("right,2", "both,2", &["geometry.csv:3", "left or right"]);
    let (long, shown) = ("x".repeat(100), format!("`{}...`", "x".repeat(60)));
    refused("right,2", &format!("{long},2"), &["geometry.csv:3", &shown]);
    refused("right,2", &format!("right,{long}"), &["geometry.csv:3", &shown]);
    refused("right,1,100,100", "right,1,100,x", &["geometry.csv:2", "x1_mm"]);
}

/// Tests with a recording of a person, which is not public.
mod unpublished {
    use super::common::recordings;
    use plantar::{Region, Side};
    use recording::{Recording, pedar};

    /// The real measurement: the left and the right foot.
    fn both_feet() -> [Recording; 2] {
        let folder = recordings().join("pedar");
        let (asc, geometry) = (folder.join("pedar_example.asc"), folder.join("geometry.csv"));
        [Side::Left, Side::Right].map(|side| pedar::import(&asc, &geometry, side, &mut |_, _| {}).unwrap())
    }

    /// The mean force per region over some frames, N.
    fn region_forces_n(recording: &Recording, frames: std::ops::Range<usize>) -> [f64; 8] {
        let mut forces_n = [0.0; 8];
        for i in frames.clone() {
            for (cell, &kpa) in recording.layout.cells.iter().zip(recording.frame(i)) {
                forces_n[cell.region as usize] += f64::from(kpa) * cell.area_mm2 * 1e-3 / frames.len() as f64;
            }
        }
        forces_n
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn the_force_while_standing_is_plausible_for_the_mass_of_a_person() {
        let [left, right] = both_feet();
        assert_eq!((left.frames(), left.cells()), (1505, 99));
        assert!((left.rate_hz - 100.0).abs() < 1e-6);
        for i in (0..300).step_by(20) {
            let force_n = left.force_n(i) + right.force_n(i);
            assert!((700.0..1100.0).contains(&force_n), "{force_n} N");
        }
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn both_insoles_have_the_same_foot_coordinates() {
        let [left, right] = both_feet();
        for foot in [&left, &right] {
            let cells = &foot.layout.cells;
            // The first sensor is at the heel, at the medial end of its row. The last sensor is at the toes.
            assert!(cells[0].y_mm < 30.0 && cells[0].x_mm < cells[4].x_mm);
            assert_eq!(cells[0].region, Region::Heel);
            assert!(cells[98].y_mm > 250.0 && cells[98].region >= Region::Hallux);
            let least = |along: fn(&recording::Cell) -> f64| cells.iter().map(along).fold(f64::INFINITY, f64::min);
            assert!((0.0..15.0).contains(&least(|c| c.x_mm)));
            assert!((0.0..15.0).contains(&least(|c| c.y_mm)));
            for region in Region::ALL {
                assert!(cells.iter().any(|c| c.region == region), "no {region:?}");
            }
        }
        // The insoles are mirror images.
        for (a, b) in left.layout.cells.iter().zip(&right.layout.cells) {
            assert!((a.x_mm - b.x_mm).abs() < 3.0 && (a.y_mm - b.y_mm).abs() < 3.0);
        }
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn while_standing_the_heel_carries_most_and_the_medial_midfoot_less_than_the_lateral() {
        for foot in &both_feet() {
            let standing_n = region_forces_n(foot, 0..100);
            let most = standing_n.iter().copied().fold(0.0, f64::max);
            assert_eq!(standing_n[Region::Heel as usize], most);
            let midfoot = |medial: bool| -> f64 {
                foot.layout
                    .cells
                    .iter()
                    .zip(foot.frame(50))
                    .filter(|(c, _)| (90.0..170.0).contains(&c.y_mm) && (c.x_mm < 50.0) == medial)
                    .map(|(c, &kpa)| f64::from(kpa) * c.area_mm2)
                    .sum()
            };
            assert!(midfoot(false) > midfoot(true));
        }
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public: PLANTAR_RECORDINGS"]
    fn steps_begin_at_the_heel_and_end_at_the_forefoot() {
        let [left, right] = both_feet();
        for foot in [&left, &right] {
            // A shoe presses on the foot during swing, too. The threshold is above the force of this pressure.
            let is_in_stance = |i: usize| foot.force_n(i) > 200.0;
            // For each step, whether forefoot and toes carry less than 30 % of the load at its start, and more than 60 % at its
            // end.
            let mut lands_on_heel = Vec::new();
            let mut leaves_from_front = Vec::new();
            for i in 1..foot.frames() {
                let front_share = |i: usize| {
                    let forces_n = region_forces_n(foot, i..i + 1);
                    forces_n[Region::Metatarsals12 as usize..].iter().sum::<f64>() / foot.force_n(i)
                };
                match (is_in_stance(i - 1), is_in_stance(i)) {
                    (false, true) => lands_on_heel.push(front_share(i) < 0.3),
                    (true, false) => leaves_from_front.push(front_share(i - 1) > 0.6),
                    _ => {}
                }
            }
            let three_quarters = |steps: &[bool]| steps.iter().filter(|&&ok| ok).count() * 4 >= steps.len() * 3;
            assert!(
                lands_on_heel.len() >= 3 && leaves_from_front.len() >= 3,
                "{lands_on_heel:?} {leaves_from_front:?}"
            );
            assert!(three_quarters(&lands_on_heel), "{lands_on_heel:?}");
            assert!(three_quarters(&leaves_from_front), "{leaves_from_front:?}");
        }
    }
}
