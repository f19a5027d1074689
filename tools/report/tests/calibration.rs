//! The web page on a calibration.

use fit::calibration::Calibration;
use recording::Plateaus;
use std::path::Path;

/// The plateaus of an insole with eleven cells, one of which does not respond, at these pressures, kPa. The codes follow the law
/// of the firmware, up to full scale.
fn plateaus(pressures_kpa: &[f64]) -> Plateaus {
    let cell = r#"{"x_mm":10.0,"y_mm":20.0,"area_mm2":60.0,"row_column":0}"#;
    let plateau = |kpa: &f64| {
        let code = (6000.0 + 65_520.0 * (kpa / 1000.0).powf(0.8)).min(65_520.0);
        let codes = [vec![code; 10], vec![6000.0]].concat();
        let changes = [0.0; 11];
        format!(
            r#"{{"nominal_kpa":{kpa},"pressure_kpa":{kpa},"unix_s":0,"frames":3,"codes":{codes:?},"changes":{changes:?}}}"#
        )
    };
    let head = r#""version":1,"side":"Left","serial_number":"<b>&","firmware":"1.0.0","note":"gauge 7""#;
    let law = r#""law":{"full_kpa":1000.0,"exponent":0.8}"#;
    let (cells, plateaus) = ([cell; 11].join(","), pressures_kpa.iter().map(plateau).collect::<Vec<_>>().join(","));
    let text = format!(r#"{{{head},{law},"cells":[{cells}],"plateaus":[{plateaus}]}}"#);
    Plateaus::parse(text.as_bytes(), Path::new("plateaus.json")).expect("plateaus")
}

fn page(pressures_kpa: &[f64]) -> String {
    let plateaus = plateaus(pressures_kpa);
    report::calibration_html(&plateaus, &Calibration::of(&plateaus).expect("a calibration"))
}

#[test]
fn the_page_has_the_results_loads_nothing_and_escapes_text() {
    let html = page(&[0.0, 50.0, 100.0, 200.0, 950.0, 0.0]);
    for expected in [
        "Calibration of a left insole",
        "6 plateaus",
        "exponent 0.800",
        "Cell 10: no response",
        "fits this sheet",
        "gauge 7",
        "not used: too many cells",
    ] {
        assert!(html.contains(expected), "no {expected}");
    }
    assert!(html.contains("&lt;b&gt;&amp;") && !html.contains("<b>&"));
    for link in ["src=", "http://", "https://", "<script", "@import", "url("] {
        assert!(!html.contains(link), "{link}");
    }
    assert!(!html.contains("NaN") && !html.contains("inf"), "all coordinates are numbers");
}

#[test]
fn a_law_that_was_not_checked_is_not_shown() {
    let html = page(&[0.0, 50.0, 100.0]);
    assert!(html.contains("was not checked") && !html.contains("law of the plateaus"));
    assert!(!html.contains("NaN") && !html.contains("inf"), "all coordinates are numbers");
}
