//! Area and force of each region in a typical step (Figs. 5 and 6 of the paper), and the sum over the regions (Fig. 6i).

use crate::drawing::{self, Curves, Drawing, Scale, unfitted};
use crate::format::percent;
use crate::region::{TITLES, colour, fit_of, fitted};
use fit::Study;
use fit::quality::Evaluated;
use maud::html;

/// Width of a chart.
pub const WIDTH: f64 = 260.0;
/// Height of a chart of area.
pub const AREA_HEIGHT: f64 = 128.0;
/// Height of a chart of force.
pub const FORCE_HEIGHT: f64 = 162.0;
const LEFT: f64 = 38.0;
const TOP: f64 = 22.0;
const BOTTOM: f64 = 32.0;

/// The typical step of a region: the step with the median error.
pub struct Typical {
    /// Index in [`Study::steps`].
    pub step: usize,
    /// Time from heel strike to the start of the region's contact, s.
    start_s: f64,
    curves: Evaluated,
}

impl Typical {
    /// Selects the step.
    ///
    /// # Errors
    /// The reason why the region was not fitted to these steps.
    pub fn of(study: &Study, region: usize) -> Result<Self, String> {
        let fit = fit_of(study, region)?;
        let steps = fit.steps.iter().filter_map(|&step| {
            let (start_s, curves) = evaluate(study, step, region)?;
            Some(Self { step, start_s, curves })
        });
        // In each step that a fit uses, the region is in contact, so a step is missing only if the fit is of other steps.
        median(steps.collect(), Self::nrmse).ok_or_else(|| "the fit is of other steps than those of the study".into())
    }

    /// NRMSE of the model force, as a fraction.
    pub fn nrmse(&self) -> f64 {
        self.curves.nrmse()
    }
}

/// The start of a region's contact after heel strike, s, and its curves in a step with the parameters fitted to all steps.
fn evaluate(study: &Study, step: usize, region: usize) -> Option<(f64, Evaluated)> {
    let fit = fit_of(study, region).ok()?;
    let curves = &study.steps.get(step)?.regions[region];
    let (area_mm2, _, sample_s) = curves.of(study.options.filter);
    let first = area_mm2.iter().position(|area| *area > 0.0)?;
    Some((first as f64 * sample_s, Evaluated::new(curves, study.options.filter, &fit.law)?))
}

/// The element with the median error.
fn median<T>(mut all: Vec<T>, error: impl Fn(&T) -> f64) -> Option<T> {
    all.sort_by(|a, b| error(a).total_cmp(&error(b)));
    (!all.is_empty()).then(|| all.swap_remove((all.len() - 1) / 2))
}

/// The sum of the forces over the fitted regions, in the step with the median error.
pub struct Sum {
    /// Index in [`Study::steps`].
    pub step: usize,
    sample_s: f64,
    /// Measured force on the whole foot, N.
    whole_n: Vec<f64>,
    /// Measured force on the fitted regions, N.
    measured_n: Vec<f64>,
    /// Model force on the fitted regions, N.
    model_n: Vec<f64>,
}

impl Sum {
    /// Selects the step; `None` if no region was fitted to these steps.
    pub fn of(study: &Study) -> Option<Self> {
        fitted(study).next()?;
        let sums = (0..study.steps.len()).filter_map(|step| Self::of_step(study, step));
        median(sums.collect(), Self::nrmse)
    }

    fn of_step(study: &Study, step: usize) -> Option<Self> {
        let regions = &study.steps[step].regions;
        let curves = |region: usize| regions[region].of(study.options.filter);
        let (area_mm2, _, sample_s) = curves(0);
        let none = vec![0.0; area_mm2.len()];
        let mut sum = Self { step, sample_s, whole_n: none.clone(), measured_n: none.clone(), model_n: none };
        (0..8).for_each(|region| add(&mut sum.whole_n, 0, curves(region).1));
        for (region, _) in fitted(study) {
            add(&mut sum.measured_n, 0, curves(region).1);
            if let Some((start_s, evaluated)) = evaluate(study, step, region) {
                add(&mut sum.model_n, (start_s / sample_s).round() as usize, &evaluated.model_n);
            }
        }
        sum.nrmse().is_finite().then_some(sum)
    }

    /// NRMSE of the sum over the whole stance, as a fraction.
    pub fn nrmse(&self) -> f64 {
        let squares: f64 = self.model_n.iter().zip(&self.measured_n).map(|(a, b)| (a - b) * (a - b)).sum();
        (squares / self.measured_n.len() as f64).sqrt() / largest([&self.measured_n])
    }

    /// Largest measured force on the fitted regions, divided by that on the whole foot.
    pub fn share(&self) -> f64 {
        largest([&self.measured_n]) / largest([&self.whole_n])
    }
}

/// Adds `values` to `sum` from index `start` on.
fn add(sum: &mut [f64], start: usize, values: &[f64]) {
    sum.iter_mut().skip(start).zip(values).for_each(|(sum, value)| *sum += value);
}

/// The largest value of several curves; 0 if no value is positive.
fn largest<'v>(curves: impl IntoIterator<Item = &'v Vec<f64>>) -> f64 {
    curves.into_iter().flatten().copied().fold(0.0, f64::max)
}

/// Length of the time axis of all charts, s: the longest stance time, at least 0.1 s.
pub fn duration_s(study: &Study) -> f64 {
    study.steps.iter().map(|step| step.duration_s).fold(0.1, f64::max)
}

/// The scales of a chart with values up to `largest`.
fn chart(study: &Study, height: f64, largest: f64) -> Curves {
    Curves {
        x: Scale::linear([0.0, duration_s(study)], [LEFT, WIDTH - 6.0]),
        y: Scale::linear([0.0, (1.05 * largest).max(1e-3)], [height - BOTTOM, TOP]),
    }
}

/// The chart of contact area, measured and filtered; `None` if the region was not fitted.
pub fn area(study: &Study, region: usize, typical: &Result<Typical, String>) -> Option<Drawing> {
    let Typical { start_s, curves, .. } = typical.as_ref().ok()?;
    let title = recording::area_title(&study.contact);
    let chart = chart(study, AREA_HEIGHT, largest([&curves.area_mm2, &curves.filtered_mm2]));
    // The direct filter leaves the area unchanged, except for rounding errors.
    const ROUNDING: f64 = 1e-9;
    let squares: f64 = curves.filtered_mm2.iter().zip(&curves.area_mm2).map(|(a, b)| (a - b) * (a - b)).sum();
    let nrmse = (squares / curves.area_mm2.len() as f64).sqrt() / largest([&curves.area_mm2]);
    Some(Drawing {
        width: WIDTH,
        height: AREA_HEIGHT,
        label: format!("{}: {title} over time, NRMSE {} %", TITLES[region], percent(nrmse)),
        body: html! {
            (chart.axes("", &format!("{title}, mm²")))
            @if nrmse > ROUNDING { text.end x=(WIDTH - 6.0) y=(TOP - 8.0) { "NRMSE " (percent(nrmse)) " %" } }
            path.points d=(chart.points(*start_s, curves.sample_s, &curves.area_mm2)) {}
            path.model.(colour(region)) d=(chart.line(*start_s, curves.sample_s, &curves.filtered_mm2)) {}
        },
    })
}

/// The chart of force: measured, smoothed by the polynomial of the paper, and of the model. For a region that was not fitted, a
/// drawing with the reason.
pub fn force(study: &Study, region: usize, typical: &Result<Typical, String>) -> Drawing {
    let Typical { start_s, curves, .. } = match typical {
        Ok(typical) => typical,
        Err(reason) => return unfitted(WIDTH, FORCE_HEIGHT, TITLES[region], reason),
    };
    let chart = chart(study, FORCE_HEIGHT, largest([&curves.measured_n, &curves.smoothed_n, &curves.model_n]));
    let nrmse = percent(curves.nrmse());
    Drawing {
        width: WIDTH,
        height: FORCE_HEIGHT,
        label: format!("{}: measured and model force over time, NRMSE {nrmse} %", TITLES[region]),
        body: html! {
            (chart.axes("s after heel strike", "force, N"))
            text.end x=(WIDTH - 6.0) y=(TOP - 8.0) { "NRMSE " (nrmse) " %" }
            path.points d=(chart.points(*start_s, curves.sample_s, &curves.measured_n)) {}
            path.line d=(chart.line(*start_s, curves.sample_s, &curves.smoothed_n)) {}
            path.model.(colour(region)) d=(chart.line(*start_s, curves.sample_s, &curves.model_n)) {}
        },
    }
}

/// The chart of the sum over the fitted regions, measured and of the model.
pub fn sum(study: &Study, sum: Option<&Sum>) -> Drawing {
    let Some(sum) = sum else {
        return unfitted(WIDTH, FORCE_HEIGHT, "Sum of the regions", "no region was fitted to these steps");
    };
    let chart = chart(study, FORCE_HEIGHT, largest([&sum.whole_n, &sum.model_n]));
    let nrmse = percent(sum.nrmse());
    Drawing {
        width: WIDTH,
        height: FORCE_HEIGHT,
        label: format!("Sum of the fitted regions: measured and model force over time, NRMSE {nrmse} %"),
        body: html! {
            (chart.axes("s after heel strike", "force, N"))
            text.end x=(WIDTH - 6.0) y=(TOP - 8.0) { "NRMSE " (nrmse) " %" }
            @if sum.share() < 1.0 {
                path.line.dashed d=(chart.line(0.0, sum.sample_s, &sum.whole_n)) {}
            }
            path.points d=(chart.points(0.0, sum.sample_s, &sum.measured_n)) {}
            path.model d=(chart.line(0.0, sum.sample_s, &sum.model_n)) {}
        },
    }
}

/// The legend of the marks.
pub fn legend() -> Vec<Drawing> {
    drawing::legend_entries([
        (html! { path.points d="M3 9h0M9 9h0M15 9h0M21 9h0" {} }, "measured"),
        (html! { path.line d="M0 9h24" {} }, "measured force, smoothed"),
        (
            html! { @for region in 0..4 { path.model.(colour(region)) d={ "M" (6 * region) " 9h6" } {} } },
            "filtered area; model force",
        ),
        (html! { path.line.dashed d="M0 9h24" {} }, "whole foot, if regions are not fitted"),
    ])
}
