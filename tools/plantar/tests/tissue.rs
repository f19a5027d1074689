//! Tests `plantar fit --tissue`, and incomplete results (docs/identification.md).

use recording::Recording;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Runs a command. Returns its exit status, stdout and stderr.
fn run(folder: &Path, arguments: &str) -> (i32, String, String) {
    let mut plantar = Command::new(env!("CARGO_BIN_EXE_plantar"));
    let output = plantar.args(arguments.split_whitespace()).current_dir(folder).output().expect("the program starts");
    let text = |bytes| String::from_utf8(bytes).expect("text");
    (output.status.code().expect("an exit"), text(output.stdout), text(output.stderr))
}

/// Asserts that a command succeeds, and returns what it printed on stdout.
fn succeed(folder: &Path, arguments: &str) -> String {
    let (status, out, err) = run(folder, arguments);
    assert_eq!(status, 0, "{arguments}: {out}{err}");
    out
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).expect("a file")).expect("JSON")
}

/// Asserts that the exit status is 3, and that the results of the `expected` regions, and of no others, are incomplete, for
/// a reason that contains the given words. Returns the text on stdout, and the JSON results.
fn assert_not_whole(folder: &Path, arguments: &str, expected: &[(&str, &str)]) -> (String, Value) {
    let (status, out, err) = run(folder, &format!("{arguments} --json p.json"));
    assert_eq!(status, 3, "{out}{err}");
    let results = json(&folder.join("p.json"));
    assert_eq!(results["is_complete"], false);
    for (region, fit) in results["regions"].as_object().expect("regions") {
        let defects = fit["defects"].to_string();
        match expected.iter().find(|(name, _)| name == region) {
            Some((_, words)) => assert!(defects.contains(words) && out.contains(words), "{region}: {defects}\n{out}"),
            None => assert_eq!(defects, "[]", "{region}"),
        }
    }
    (out, results)
}

#[test]
fn measurements_of_the_tissue_determine_the_vertical_radius_and_are_named_in_every_output() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    succeed(path, "import synthetic --steps 6 --out walk.parquet");
    let tissue = "toe_2 = 8\n[heel]\nthickness_mm = 17.5\npeak_strain = 0.3\n[hallux]\nthickness_mm = 12\n";
    std::fs::write(path.join("t.toml"), tissue).expect("written");
    let out = succeed(path, "fit walk.parquet --tissue t.toml --out p.toml --json p.json --report r.html");
    assert!(
        out.contains("a measured peak strain of 30.0 %") && out.contains("an assumed largest compression"),
        "{out}"
    );
    let results = json(&path.join("p.json"));
    assert_eq!(results["is_complete"], true);
    let pinned = |region: &str| results["regions"][region]["pinned"].clone();
    assert_eq!((&pinned("heel")["by"], &pinned("heel")["d0_by"]), (&"peak_strain".into(), &"measurement".into()));
    assert_eq!(
        (&pinned("toe_2")["by"], &pinned("toe_2")["d0_by"]),
        (&"assumed_compression".into(), &"measurement".into())
    );
    assert_eq!(pinned("metatarsals_12")["d0_by"], "shoe_size");
    // The method of the paper searches the thickness, also if it was measured.
    let (_, stdout, stderr) = run(path, "fit walk.parquet --tissue t.toml --method paper --json paper.json");
    let hallux = json(&path.join("paper.json"))["regions"]["hallux"]["pinned"].clone();
    assert_eq!(hallux["d0_by"], "search", "{stdout}{stderr}");
    let compression = pinned("heel")["compression"].as_f64().expect("a number");
    assert!((compression - 0.3).abs() < 1e-9, "{compression}");
    let text = std::fs::read_to_string(path.join("p.toml")).expect("a file");
    assert!(
        text.contains("by a measured peak strain of 30.0 %") && text.contains("fixed, not identified: measured"),
        "{text}"
    );
    let report = std::fs::read_to_string(path.join("r.html")).expect("a report");
    assert!(report.contains("a measured peak strain of 30.0 %"));
    // Only the heel has a measured thickness and a measured strain.
    for (region, scale, percent) in
        [("heel", "measured", 0), ("toe_2", "assumed_compression", 50), ("metatarsals_12", "assumed", 100)]
    {
        let pinned = pinned(region);
        assert_eq!(
            (&pinned["deformation_scale"], &pinned["assumed_percent"]),
            (&scale.into(), &percent.into()),
            "{region}"
        );
    }
    assert!(
        out.contains("deformation (scaled by assumption)") && report.contains("deformation (scaled by assumption)")
    );
    let replayed = succeed(path, "replay walk.parquet --params p.toml");
    assert!(replayed.contains("deformation (scaled by assumption) mm"), "{replayed}");
    assert!(replayed.contains("heel 0 %") && replayed.contains("toe_2 50 %"), "{replayed}");
    assert!(succeed(path, "replay walk.parquet").contains("100 % in all regions"));
    // A parameter file in which the scale of every region was measured: the line `deformation_scale = "measured"` is added at the
    // end of each region's table, that is before the header of the next region, and at the end of the file. The one before the
    // first header, `[regions.heel`, is removed again. The lines `deformation_scale` that `fit` wrote are removed.
    let text = text.replace("\n[regions", "\ndeformation_scale = \"measured\"\n[regions");
    let text: String = text.split_inclusive('\n').filter(|line| !line.contains("# source of C")).collect();
    let text = text.replacen("\ndeformation_scale = \"measured\"\n[regions.heel", "\n[regions.heel", 1);
    std::fs::write(path.join("all.toml"), text + "deformation_scale = \"measured\"\n").expect("written");
    let replayed = succeed(path, "replay walk.parquet --params all.toml");
    assert!(replayed.contains("deformation mm") && !replayed.contains("assumption"), "{replayed}");
    // The title of the areas depends on the contact rule.
    assert!(replayed.contains("effective area mm2"), "{replayed}");
    assert!(succeed(path, "replay walk.parquet --contact-full 0").contains("contact area mm2"));
    // Six steps suffice for the fits with two other thresholds, three other pressures from which a cell counts with its whole
    // area, and two other filters, but not for the fits that each leave out a quarter of the steps.
    let sensitivity = &results["sensitivity"];
    assert_eq!(sensitivity["variants"].as_array().expect("variants").len(), 2 + 3 + 2);
    assert!(sensitivity["skipped"][0].as_str().expect("a sentence").contains("at least 8 steps"));

    // The radius of curvature that the heel would have if C were half as large.
    let heel = &results["regions"]["heel"]["ellipsoid"];
    let mm = |name: &str| heel[name].as_f64().expect("a number");
    let radius_mm = mm("a_mm") * mm("a_mm") / mm("c_mm") * 2.0;
    let tissue = format!(
        "hallux = 41\n[heel]\nthickness_mm = 17.5\npeak_strain = 0.3\ncurvature_mm = {{ medial_lateral = {radius_mm} }}\n"
    );
    std::fs::write(path.join("t.toml"), tissue).expect("written");
    let expected = [("heel", "contradict each other"), ("hallux", "thickness_mm = 41 is out of range")];
    let (_, results) = assert_not_whole(path, "fit walk.parquet --tissue t.toml", &expected);
    // Instead of the contradictory measurements, the compression is used that is assumed without measurements: 45.7 %.
    let pinned = &results["regions"]["heel"]["pinned"];
    assert_eq!(
        (&pinned["by"], &pinned["compression"].as_f64().map(|compression| (compression * 1e9).round())),
        (&"assumed_compression".into(), &Some(0.457e9))
    );
    let hallux_mm = results["regions"]["hallux"]["pinned"]["d0_mm"].as_f64().expect("a number");
    assert!((hallux_mm - 10.0).abs() < 1e-9, "typical, {hallux_mm} mm");
}

#[test]
fn a_single_step_and_a_shifted_insole_are_reported_for_each_affected_region() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    succeed(path, "import synthetic --steps 12 --out walk.parquet");
    succeed(path, "fit walk.parquet");
    let all = plantar::Region::ALL;
    // `fit --steps 3` uses only the step with the number 3.
    let (status, out, _) = run(path, "fit walk.parquet --steps 3 --json one.json");
    assert_eq!(status, 3);
    assert_eq!(out.matches("INCOMPLETE: only one step").count(), all.len(), "{out}");

    // From the middle of the recording on, the cells of the heel measure half of the pressure, as if the insole had shifted.
    let mut recording = Recording::read(path.join("walk.parquet")).expect("a recording");
    let regions: Vec<_> = recording.layout.cells.iter().map(|cell| cell.region).collect();
    let middle = recording.pressure_kpa.len() / 2;
    for (i, kpa) in recording.pressure_kpa.iter_mut().enumerate().skip(middle) {
        if regions[i % regions.len()] == plantar::Region::Heel {
            *kpa *= 0.5;
        }
    }
    recording.write(path.join("shifted.parquet")).expect("written");
    assert_not_whole(path, "fit shifted.parquet --out shifted.toml", &[("heel", "changes within the recording")]);
}
