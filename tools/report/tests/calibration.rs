//! The web page on a calibration.

use fit::calibration::Calibration;
use recording::Plateaus;
use std::path::Path;

/// The plateaus of an insole with eleven cells, one of which does not respond, at these pressures, kPa. The codes follow the law of
/// the firmware.
fn plateaus(pressures_kpa: &[f64]) -> Plateaus {
    let cell = r#"{"x_mm":10.0,"y_mm":20.0,"area_mm2":60.0}"#;
    let plateau = |kpa: &f64| {
        let code = 6000.0 + 65_520.0 * (kpa / 1000.0).powf(0.8);
        format!(
            r#"{{"pressure_kpa":{kpa},"frames":3,"codes":[{code},{code},{code},{code},{code},{code},{code},{code},{code},{code},6000],"changes":[0,0,0,0,0,0,0,0,0,0,0]}}"#
        )
    };
    let text = format!(
        r#"{{"version":1,"side":"Left","serial_number":"<b>&","layout_id":1,"law":{{"full_kpa":1000.0,"exponent":0.8}},"cells":[{}],"plateaus":[{}]}}"#,
        [cell; 11].join(","),
        pressures_kpa.iter().map(plateau).collect::<Vec<_>>().join(",")
    );
    Plateaus::parse(text.as_bytes(), Path::new("plateaus.json")).expect("plateaus")
}

fn page(pressures_kpa: &[f64]) -> String {
    let plateaus = plateaus(pressures_kpa);
    report::calibration_html(&plateaus, &Calibration::of(&plateaus).expect("a calibration"))
}

#[test]
fn the_page_has_the_results_loads_nothing_and_escapes_text() {
    let html = page(&[0.0, 50.0, 100.0, 200.0, 0.0]);
    for expected in [
        "Calibration of a left insole",
        "5 plateaus",
        "exponent 0.800",
        "Cell 10: it does not respond",
        "fits this sheet",
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
