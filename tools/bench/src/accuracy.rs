//! The device's single precision against double precision on the same codes.

use crate::Figures;
use anyhow::Result;
use parameters::{InsoleSize, Parameters};
use plantar::Real;
use plantar::contact::ContactRule;
use plantar::insole::{DEVICE_CELLS, Insole};
use plantar::stance::StanceRule;
use recording::{Recording, VirtualInsole, synthetic};

/// Largest differences.
#[derive(Default)]
struct Worst {
    force: f64,
    area: f64,
}

pub fn measure(figures: &mut Figures) -> Result<()> {
    let walk = synthetic::walk(&synthetic::SyntheticWalk { steps: 30, ..Default::default() }).recording;
    let mut worst = Worst::default();
    for contact in [ContactRule::COUNTED, ContactRule { full_kpa: 100.0, ..ContactRule::COUNTED }] {
        compare(&walk, contact, &mut worst)?;
    }
    figures.add(
        "device_vs_host_force_rel",
        worst.force,
        "f32 against f64: largest difference of a force over its region's peak",
    );
    figures.add("device_vs_host_area_rel", worst.area, "the same of areas and ellipse radii, relative");
    Ok(())
}

fn compare(walk: &Recording, contact: ContactRule, worst: &mut Worst) -> Result<()> {
    let worn = VirtualInsole::new(walk, contact, StanceRule::WALKING);
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    let mut single = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    let mut double = Box::new(Insole::<f64, DEVICE_CELLS>::new());
    single.set_up(worn.setup, worn.cells.iter().copied())?;
    double.set_up(worn.setup, worn.cells.iter().copied())?;
    single.set_tissue(&tissue)?;
    double.set_tissue(&tissue)?;

    let mut codes = vec![0; worn.cells.len()];
    let mut differences = [[0.0f64; 2]; 8];
    let mut peaks = [[0.0f64; 2]; 8];
    let relative = |a: f64, b: f64| if b == 0.0 { a.abs() } else { (a / b - 1.0).abs() };
    for i in 0..worn.frames(walk) {
        worn.codes_of(walk, i, &mut codes);
        let toe_off = single.frame(i as u32, &codes);
        assert_eq!(toe_off, double.frame(i as u32, &codes), "f32 and f64 disagree about toe off in frame {i}");
        for region in 0..8 {
            let (s, d) = (single.loads()[region], double.loads()[region]);
            let forces = [
                (f64::from(s.frame.force.force_n), d.frame.force.force_n),
                (f64::from(s.tissue.model_n), d.tissue.model_n),
            ];
            for (k, (s, d)) in forces.into_iter().enumerate() {
                differences[region][k] = differences[region][k].max((s - d).abs());
                peaks[region][k] = peaks[region][k].max(d);
            }
            worst.area = worst.area.max(relative(f64::from(s.frame.area.area_mm2::<f32>()), d.frame.area.area_mm2()));
            if let (Some(s), Some(d)) = (single.ellipse(region), double.ellipse(region)) {
                worst.area =
                    worst.area.max(relative(s.r_a_mm.to_f64(), d.r_a_mm)).max(relative(s.r_b_mm.to_f64(), d.r_b_mm));
            }
        }
        if toe_off {
            for region in 0..8 {
                let (s, d) = (single.step_region(region), double.step_region(region));
                let peak = d.measured_peak_n.max(d.model_peak_n).max(f64::MIN_POSITIVE);
                worst.force = worst.force.max((f64::from(s.model_peak_n) - d.model_peak_n).abs() / peak);
                worst.force = worst.force.max((f64::from(s.measured_peak_n) - d.measured_peak_n).abs() / peak);
            }
        }
    }
    for (difference, peak) in differences.iter().flatten().zip(peaks.iter().flatten()) {
        if *peak > 0.0 {
            worst.force = worst.force.max(difference / peak);
        }
    }
    Ok(())
}
