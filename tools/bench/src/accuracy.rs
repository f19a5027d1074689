//! Compares single precision, as on the insole, with double precision on the same codes.

use anyhow::Result;
use bench::{Figures, raise};
use parameters::{InsoleSize, Parameters};
use plantar::Real;
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::Tissue;
use recording::{Recording, VirtualInsole, synthetic};

/// Largest relative differences so far.
#[derive(Default)]
struct Worst {
    /// Largest difference of a force, relative to the peak force of the region, or of a force-time integral, relative to this
    /// peak times the contact time.
    force: f64,
    /// Largest difference of an area or of a radius of an ellipse, relative to the value.
    area: f64,
}

/// Measures the differences with counted cells and with covered shares (whole cells from 100 kPa on), each with typical
/// parameters and those of [`tight_tissue`].
pub fn measure(figures: &mut Figures) -> Result<()> {
    let walk = synthetic::walk(&synthetic::SyntheticWalk { steps: 30, ..Default::default() }).recording;
    let mut worst = Worst::default();
    let typical = Parameters::typical(InsoleSize::default()).tissue();
    for contact in [ContactRule::COUNTED, ContactRule { full_kpa: 100.0, ..ContactRule::COUNTED }] {
        for tissue in [&typical, &tight_tissue(&walk, contact, &typical)?] {
            compare(&walk, contact, tissue, &mut worst)?;
        }
    }
    figures.add(
        "device_vs_host_force_rel",
        worst.force,
        "largest difference between f32 and f64: of a force over its peak, of an integral over peak * contact time",
    );
    figures.add(
        "device_vs_host_area_rel",
        worst.area,
        "largest relative difference of an area or ellipse radius between f32 and f64",
    );
    Ok(())
}

/// Evaluates a walk in both precisions, and raises `worst` to the largest differences.
fn compare(walk: &Recording, contact: ContactRule, tissue: &Tissue, worst: &mut Worst) -> Result<()> {
    let virtual_insole = VirtualInsole::new(walk, contact, StanceRule::ADAPTIVE);
    let mut single = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    let mut double = Box::new(Insole::<f64, DEVICE_CELLS>::new());
    single.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied())?;
    double.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied())?;
    single.set_tissue(tissue)?;
    double.set_tissue(tissue)?;

    let mut codes = vec![0; virtual_insole.cells.len()];
    let mut differences = [[0.0f64; 2]; 8];
    let mut peaks = [[0.0f64; 2]; 8];
    let relative = |a: f64, b: f64| if b == 0.0 { a.abs() } else { (a / b - 1.0).abs() };
    for i in 0..virtual_insole.frames(walk) {
        virtual_insole.codes_of(walk, i, &mut codes);
        let toe_off = single.frame(i as u32, &codes);
        assert_eq!(toe_off, double.frame(i as u32, &codes), "f32 and f64 disagree about toe off in frame {i}");
        for region in 0..8 {
            let (s, d) = (single.loads()[region], double.loads()[region]);
            let forces = [
                (f64::from(s.frame.force.force_n), d.frame.force.force_n),
                (f64::from(s.tissue.model_n), d.tissue.model_n),
            ];
            for (k, (s, d)) in forces.into_iter().enumerate() {
                raise(&mut differences[region][k], (s - d).abs());
                peaks[region][k] = peaks[region][k].max(d);
            }
            raise(&mut worst.area, relative(f64::from(s.frame.area.area_mm2::<f32>()), d.frame.area.area_mm2()));
            if let (Some(s), Some(d)) = (single.ellipse(region), double.ellipse(region)) {
                raise(&mut worst.area, relative(s.r_a_mm.to_f64(), d.r_a_mm));
                raise(&mut worst.area, relative(s.r_b_mm.to_f64(), d.r_b_mm));
            }
        }
        if toe_off {
            for region in 0..8 {
                let (s, d) = (single.step_region(region), double.step_region(region));
                let forces = [
                    (f64::from(s.model_peak_n), d.model_peak_n, d.model_peak_n),
                    (f64::from(s.measured_peak_n), d.measured_peak_n, d.measured_peak_n),
                    // The difference of an integral is relative to the peak force times the contact time.
                    (f64::from(s.model_integral_n_s), d.model_integral_n_s, d.model_peak_n * d.contact_s),
                    (f64::from(s.measured_integral_n_s), d.measured_integral_n_s, d.measured_peak_n * d.contact_s),
                ];
                for (s, d, peak) in forces {
                    raise(&mut worst.force, (s - d).abs() / peak.max(f64::MIN_POSITIVE));
                }
                raise(&mut worst.area, relative(f64::from(s.area_peak_mm2), d.area_peak_mm2));
                if let (Some(s), Some(d)) = (s.ellipse_at_peak, d.ellipse_at_peak) {
                    raise(&mut worst.area, relative(s.r_a_mm.to_f64(), d.r_a_mm));
                    raise(&mut worst.area, relative(s.r_b_mm.to_f64(), d.r_b_mm));
                }
            }
        }
    }
    for (difference, peak) in differences.iter().flatten().zip(peaks.iter().flatten()) {
        if *peak > 0.0 {
            raise(&mut worst.force, difference / peak);
        }
    }
    Ok(())
}

/// Ellipsoids with n = 1.5 and m = 1. The largest section of each is only one percent larger than the largest area by this
/// contact rule. With these, single precision is less accurate than with typical parameters: near the largest section, the
/// deformation changes steeply with the area.
fn tight_tissue(walk: &Recording, contact: ContactRule, typical: &Tissue) -> Result<Tissue> {
    let virtual_insole = VirtualInsole::new(walk, contact, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f64, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied())?;
    let mut codes = vec![0; virtual_insole.cells.len()];
    let mut largest_mm2 = [0.0f64; 8];
    for i in 0..walk.frames() {
        virtual_insole.codes_of(walk, i, &mut codes);
        insole.frame(i as u32, &codes);
        for (largest, load) in largest_mm2.iter_mut().zip(insole.loads()) {
            *largest = largest.max(load.frame.area.area_mm2());
        }
    }
    let mut force_laws = typical.force_laws;
    for (law, largest) in force_laws.iter_mut().zip(largest_mm2) {
        law.ab_m2 = (1.01e-6 * largest / std::f64::consts::PI) as f32;
        (law.n, law.m, law.damping_pa_s) = (1.5, 1.0, 20e3);
    }
    Ok(Tissue::new(force_laws))
}
