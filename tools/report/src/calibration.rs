//! The web page on the calibration of an insole by known pressures.

use crate::document::{document, legend, section, wide};
use crate::drawing::{Curves, Drawing, Scale, legend_entries, square};
use crate::foot::Frame;
use crate::format::{count, number, percent, signed_percent};
use fit::calibration::{Calibration, Check, CheckResult, Errors, Verdict, quantile};
use maud::{Markup, html};
use plantar::pipeline::calibrate::{CellCalibration, FULL_CODE};
use recording::{Plateau, Plateaus};
use std::fmt::Write as _;

/// Width and height of a chart.
const CHART: [f64; 2] = [460.0, 230.0];
/// Units of the map per mm.
const MAP_SCALE: f64 = 1.4;
/// Margin around the cells of the map, mm.
const MARGIN_MM: f64 = 8.0;
/// The classes of the gains in the map: the ratio to the median gain below which a gain is in the class, its colour and its name.
const CLASSES: [(f64, &str, &str); 5] = [
    (0.8, "s0", "below 0.8"),
    (0.9, "s1", "0.8 to 0.9"),
    (1.1, "s2", "0.9 to 1.1"),
    (1.25, "s4", "1.1 to 1.25"),
    (f64::INFINITY, "s5", "from 1.25"),
];

/// The page as one HTML file, which loads no other resource and contains no scripts.
pub fn html(plateaus: &Plateaus, calibration: &Calibration) -> String {
    let page = document(
        &format!("Calibration of a {} insole", plateaus.side.name()),
        &format!(
            "Insole {}, firmware {}, {}, {}",
            plateaus.serial_number,
            plateaus.firmware,
            count(plateaus.cells.len(), "cell"),
            count(plateaus.plateaus.len(), "plateau")
        ),
        &html! {
            (section("summary", "Summary", summary(plateaus, calibration)))
            (section("errors", "Errors at the plateaus", errors(calibration)))
            (section("law", "Codes and pressures", codes(plateaus, calibration)))
            (section("gains", "Gains", gains(plateaus, calibration)))
        },
    );
    page.into_string()
}

fn summary(plateaus: &Plateaus, calibration: &Calibration) -> Markup {
    let results = || calibration.checks.iter().filter_map(|check| check.result);
    let worst = |values: Vec<f64>| values.into_iter().reduce(f64::max).map_or("–".into(), percent);
    let inner = results().filter(|result| !result.is_end).map(|result| result.left_out.most).collect();
    let ends = results().filter(|result| result.is_end).map(|result| result.left_out.most).collect();
    html! {
        dl.facts {
            @if !plateaus.note.is_empty() {
                dt { "Note" }
                dd { (plateaus.note) }
            }
            dt { "Consistency" }
            dd {
                "At a pressure that was left out of the calibration, 95 % of the cells agree with the gauge to within "
                (worst(inner)) " %, beyond the other pressures to within " (worst(ends)) " % (the worst plateaus); at the \
                plateaus themselves to within " (worst(results().map(|result| result.errors.most).collect())) " %. This does \
                not include errors of the gauge, uneven pressure, temperature and creep."
            }
            @if let Some(hysteresis) = calibration.hysteresis {
                dt { "Hysteresis" }
                dd {
                    "At " (number(hysteresis.nominal_kpa)) " kPa, the reading after higher pressures differs by "
                    (signed_percent(hysteresis.difference)) " %."
                }
            }
            @if let Some(change) = calibration.zero_change {
                dt { "Zero" }
                dd {
                    "Without load, the mean code changed by " (format!("{:+.0}", change.codes).replace('-', "−"))
                    " from the first to the last plateau, " (signed_percent(change.share))
                    " % of the codes at the lowest pressure."
                }
            }
            dt { "Sensor law" }
            dd { (law(plateaus, calibration)) }
            @if calibration.failures.iter().any(Option::is_some) {
                dt { "Failing cells" }
                dd {
                    @for (cell, failure) in calibration.failures.iter().enumerate() {
                        @if let Some(failure) = failure { "Cell " (cell) ": " (failure) ". " }
                    }
                }
            }
        }
    }
}

fn law(plateaus: &Plateaus, calibration: &Calibration) -> Markup {
    let firmware = plateaus.law.exponent;
    let Some(law) = calibration.law else {
        return html! {
            "The exponent " (firmware) " of the firmware was not checked: this needs three different pressures that can be used."
        };
    };
    let [low, high] = law.interval;
    html! {
        (format!("The plateaus show the exponent {:.3} (95 % confidence interval {low:.3} to {high:.3})", law.sensor.exponent))
        (format!(" with a full scale of {:.0} kPa; the firmware has {firmware}. ", law.sensor.full_kpa))
        @match law.verdict {
            Verdict::Fits => "The law of the firmware fits this sheet.",
            Verdict::Undetermined => "The plateaus scatter too much to determine whether the law of the firmware fits.",
            Verdict::DoesNotFit => {
                strong { "The law of the firmware does not fit." }
                " Check the zero of the gauge (an error of " (format!("{:+.1}", law.gauge_offset_kpa).replace('-', "−")) " kPa would have a \
                similar effect); otherwise build the firmware with the law of the plateaus."
            }
        }
    }
}

/// The horizontal scale of the charts: the pressures, kPa.
fn pressures(calibration: &Calibration) -> Scale {
    let all = || calibration.checks.iter().map(|check| check.pressure_kpa);
    let (least, most) = (all().fold(f64::MAX, f64::min), all().fold(f64::MIN_POSITIVE, f64::max));
    // The ends of a logarithmic scale differ by a factor of at least 5.
    Scale::logarithmic([(0.8 * least).min(0.2 * most), 1.1 * most], [44.0, CHART[0] - 8.0], false)
}

fn errors(calibration: &Calibration) -> Markup {
    let ends = |errors: Errors| errors.range.map(f64::abs).into_iter().fold(0.0, f64::max);
    let results = calibration.checks.iter().filter_map(|check| check.result);
    let all = results.flat_map(|result| [result.errors, result.left_out]).map(ends);
    let most = 110.0 * all.fold(0.01, f64::max);
    let chart = Curves { x: pressures(calibration), y: Scale::linear([-most, most], [CHART[1] - 32.0, 22.0]) };
    let bar = |check: &Check| {
        let CheckResult { errors, left_out, .. } = check.result?;
        let (x, y) = (chart.x.at(check.pressure_kpa), |share: f64| chart.y.at(100.0 * share));
        Some(html! {
            path.jacobian.s1 d={ "M" (x) " " (y(errors.range[0])) "V" (y(errors.range[1])) } {}
            circle.fill.s1 cx=(x) cy=(y(errors.mean)) r="3" {}
            path.line.s5 d={ "M" (x + 5.0) " " (y(left_out.range[0])) "V" (y(left_out.range[1])) } {}
            circle.hollow.s5 cx=(x + 5.0) cy=(y(left_out.mean)) r="3" {}
        })
    };
    let drawing = Drawing {
        width: CHART[0],
        height: CHART[1],
        label: "Errors of the cells at each plateau".into(),
        body: html! {
            (chart.axes("pressure, kPa", "error, %"))
            @for check in &calibration.checks { @if let Some(bar) = bar(check) { (bar) } }
        },
    };
    let entries = legend_entries([
        (
            html! { path.jacobian.s1 d="M12 1v16" {} circle.fill.s1 cx="12" cy="9" r="3" {} },
            "calibrated with all plateaus",
        ),
        (html! { path.line.s5 d="M12 1v16" {} circle.hollow.s5 cx="12" cy="9" r="3" {} }, "this pressure left out"),
    ]);
    html! {
        (legend(&entries))
        figure.beside {
            (drawing.svg())
            figcaption {
                "Points: mean over the cells. Bars: 95 % of the cells. If a pressure is left out, its errors are those to \
                 expect at a pressure that is not among the plateaus; at the lowest and the highest one, beyond the others."
            }
        }
        (wide("Errors at the plateaus", table(calibration)))
    }
}

fn table(calibration: &Calibration) -> Markup {
    let pair = |errors: Errors| html! { td { (signed_percent(errors.mean)) } td { (percent(errors.most)) } };
    html! {
        table {
            caption {
                "In % of the pressure, in the order of measurement. Change: from the first to the last third of the measurement. \
                 95 %: 95 % of the cells are within ± this error."
            }
            thead {
                tr {
                    th scope="col" rowspan="2" { "kPa" }
                    th scope="col" rowspan="2" { "Frames" }
                    th scope="col" rowspan="2" { "Saturated" }
                    th scope="col" rowspan="2" { "Change" }
                    th scope="colgroup" colspan="2" { "All plateaus" }
                    th scope="colgroup" colspan="2" { "This pressure left out" }
                }
                tr {
                    @for _ in 0..2 {
                        // The first title of a row is left-aligned otherwise.
                        th scope="col" style="text-align:right" { "Mean error" }
                        th scope="col" { "95 %" }
                    }
                }
            }
            tbody {
                @for check in &calibration.checks {
                    tr {
                        th scope="row" { (number(check.pressure_kpa)) }
                        td { (check.frames) }
                        td { (check.saturated) }
                        @match check.result {
                            Some(result) => {
                                td { (signed_percent(result.change)) }
                                (pair(result.errors))
                                (pair(result.left_out))
                            }
                            None => td.reason colspan="5" { "not used: too many cells are saturated" },
                        }
                    }
                }
            }
        }
    }
}

/// The codes above zero of the cells at a plateau that do not fail, as parts of full scale: the quantiles 5 %, 50 % and 95 %.
fn quantiles(plateau: &Plateau, calibration: &Calibration) -> Option<[f64; 3]> {
    let codes = plateau.codes.iter().zip(&calibration.cells).zip(&calibration.failures);
    let above_zero =
        |(code, cell): (&f32, &CellCalibration)| (f64::from(*code) - f64::from(cell.offset)) / f64::from(FULL_CODE);
    let sound = codes.filter(|(_, failure)| failure.is_none()).map(|(cell, _)| above_zero(cell));
    let mut all: Vec<f64> = sound.collect();
    Some([quantile(&mut all, 0.05)?, quantile(&mut all, 0.5)?, quantile(&mut all, 0.95)?])
}

fn codes(plateaus: &Plateaus, calibration: &Calibration) -> Markup {
    let loaded = || plateaus.plateaus.iter().filter(|plateau| plateau.pressure_kpa > 0.0);
    let measured: Vec<_> = loaded().filter_map(|plateau| Some((plateau, quantiles(plateau, calibration)?))).collect();
    let ends = measured.iter().flat_map(|(_, quantiles)| *quantiles).filter(|share| *share > 0.0);
    let [least, most] =
        ends.fold([f64::MAX, f64::MIN_POSITIVE], |[least, most], share| [share.min(least), share.max(most)]);
    let chart = Curves {
        x: pressures(calibration),
        y: Scale::logarithmic([(80.0 * least).min(20.0 * most), 110.0 * most], [CHART[1] - 32.0, 22.0], false),
    };
    let least_kpa = calibration.checks.iter().map(|check| check.pressure_kpa).fold(f64::MAX, f64::min);
    let most_kpa = calibration.checks.iter().map(|check| check.pressure_kpa).fold(least_kpa, f64::max);
    let line = |full_kpa: f64, exponent: f64| {
        let mut path = String::new();
        for i in 0..=40 {
            let kpa = least_kpa * (most_kpa / least_kpa).powf(f64::from(i) / 40.0);
            let share = 100.0 * (kpa / full_kpa).powf(exponent);
            if !chart.y.is_beyond(share) {
                // Writing to a String does not fail.
                let _ = write!(
                    path,
                    "{}{:.1} {:.1}",
                    if path.is_empty() { "M" } else { "L" },
                    chart.x.at(kpa),
                    chart.y.at(share)
                );
            }
        }
        path
    };
    let firmware = line(calibration.median_gain() * f64::from(plateaus.law.full_kpa), plateaus.law.exponent.into());
    let drawing = Drawing {
        width: CHART[0],
        height: CHART[1],
        label: "Codes of the cells over the pressure, and the sensor laws".into(),
        body: html! {
            (chart.axes("pressure, kPa", "code above zero, % of full scale"))
            path.line.s1 d=(firmware) {}
            @if let Some(law) = calibration.law { path.model.dashed.s5 d=(line(law.sensor.full_kpa.into(), law.sensor.exponent.into())) {} }
            @for (plateau, [low, middle, high]) in &measured {
                @let (x, y) = (chart.x.at(plateau.pressure_kpa), |share: &f64| chart.y.at(100.0 * share));
                path.axis d={ "M" (x) " " (y(low)) "V" (y(high)) } {}
                circle.fill cx=(x) cy=(y(middle)) r="3" {}
            }
        },
    };
    let mut marks = vec![
        (html! { path.axis d="M12 1v16" {} circle.fill cx="12" cy="9" r="3" {} }, "cells: median, 5 to 95 %"),
        (html! { path.line.s1 d="M0 9h24" {} }, "law of the firmware, median gain"),
    ];
    if calibration.law.is_some() {
        marks.push((html! { path.model.dashed.s5 d="M0 9h24" {} }, "law of the plateaus"));
    }
    html! {
        (legend(&legend_entries(marks)))
        figure.beside {
            (drawing.svg())
            figcaption {
                "Both scales are logarithmic, so that a power law is a straight line, and its exponent is the slope. Points \
                 beside the line of the firmware are errors that no gain can correct."
            }
        }
    }
}

fn gains(plateaus: &Plateaus, calibration: &Calibration) -> Markup {
    let median = calibration.median_gain();
    let class =
        |gain: f64| CLASSES.iter().find(|(limit, ..)| gain / median < *limit).map_or("s5", |(_, colour, _)| colour);
    let frame = Frame::of(plateaus.cells.iter().map(|cell| [cell.x_mm.into(), cell.y_mm.into()]), MARGIN_MM);
    let [width, height] = frame.size_mm().map(|mm| MAP_SCALE * mm);
    let content = html! {
        @for (i, cell) in plateaus.cells.iter().enumerate() {
            @let gain = f64::from(calibration.cells[i].gain);
            @let path = square(cell.x_mm.into(), cell.y_mm.into(), cell.area_mm2.into());
            @if let Some(failure) = calibration.failures[i] {
                path.empty d=(path) { title { "cell " (i) ": " (failure) } }
            } @else {
                path.fill.(class(gain)) d=(path) { title { "cell " (i) ": gain " (format!("{gain:.3}")) } }
            }
        }
    };
    let map = Drawing {
        // As wide as the charts, so that it has the same scale in the page.
        width: CHART[0].max(width),
        height,
        label: "Gain of each cell relative to the median".into(),
        body: frame.show(plateaus.side, [0.0, 0.0, width, height], &content),
    };
    let classes =
        CLASSES.map(|(_, colour, name)| (html! { rect.fill.(colour) x="6" y="3" width="12" height="12" {} }, name));
    let failing = (html! { rect.empty x="6" y="3" width="12" height="12" {} }, "fails");
    let ends = [calibration.gains.first(), calibration.gains.last()].map(|end| end.copied().unwrap_or(1.0));
    html! {
        p { "Gains from " (format!("{:.3} to {:.3}", ends[0], ends[1])) ", median " (format!("{median:.3}")) "." }
        (legend(&legend_entries(classes.into_iter().chain([failing]))))
        figure.beside {
            (map.svg())
            figcaption {
                "The sole from above, the toes at the top. Colours: the gain of a cell relative to the median. A gradient \
                 across the sole suggests an uneven pressure or sheet; single lines of cells, contacts of a row or column."
            }
        }
    }
}
