//! The configuration: geometry, calibration, contact rule and stance rule; and the tissue parameters of the wearer.

use super::Insole;
use crate::num::Real;
use crate::pipeline::alert::AlertRules;
use crate::pipeline::calibrate::CellCalibration;
use crate::pipeline::cell::InsoleCell;
use crate::pipeline::live::{LiveModel, RegionLoad};
use crate::pipeline::model::ForceLaw;
use crate::pipeline::setup::{Setup, SetupCell, SetupError, check_setup};
use crate::pipeline::stance_rule::StanceLimits;
use crate::pipeline::tissue::{Tissue, TissueError};

impl<R: Real, const N: usize> Insole<R, N> {
    /// Replaces geometry, calibration, contact rule and stance rule, and resets the state of measurement; a requested measurement
    /// of the baselines ends without an outcome. The tissue parameters and their tracking, the alert rules and the state of the
    /// alerts, and the number of the next record remain. Iterates over `cells` twice.
    ///
    /// # Errors
    /// If the configuration is invalid; the previous configuration then remains in force.
    pub fn set_up<I>(&mut self, setup: Setup, cells: I) -> Result<(), SetupError>
    where
        I: Iterator<Item = SetupCell> + Clone,
    {
        let division = check_setup(&setup, cells.clone(), N)?;

        self.extent = division.extent();
        self.division = division;
        self.curve.set(&setup.sensor);
        self.cells.clear();
        for cell in cells {
            // `check_setup` has checked that all cells fit.
            let _ = self.cells.push(InsoleCell::new(&cell, &setup.contact, &self.curve, &division));
        }
        self.rows.set(&self.cells);
        self.sum_residuals();
        self.detector.set_up(&self.cells, setup.period_us);
        self.frame_rate_hz = R::of(1e6) / R::of_u32(setup.period_us);
        self.limits = StanceLimits::new(&setup.stance, setup.period_us);
        self.live = [LiveModel::NEW; 8];
        self.stance.reset(setup.period_us);
        self.cumulative.set_up(setup.period_us);
        if self.alert_rules == AlertRules::UNSET {
            self.alert_rules = AlertRules::OFF;
        }
        self.loads = [RegionLoad::NONE; 8];
        (self.last_seq, self.wraps, self.zero_s) = (None, 0, 0);
        self.setup = setup;
        Ok(())
    }

    /// Replaces the calibrations from cell `first` on, in an insole that was set up with `cells`. To be called before the first
    /// frame only, because it resets the contact of these cells. Invalid calibrations are skipped.
    pub fn recalibrate(
        &mut self,
        cells: impl Iterator<Item = SetupCell>,
        first: usize,
        calibrations: &[CellCalibration],
    ) {
        let places = self.cells.iter_mut().zip(cells).skip(first);
        for ((place, cell), &calibration) in places.zip(calibrations).filter(|(_, new)| new.is_valid()) {
            *place = InsoleCell::new(&cell.calibrated(calibration), &self.setup.contact, &self.curve, &self.division);
        }
        self.sum_residuals();
    }

    /// Replaces the tissue parameters of the wearer from the next frame on. A stance that is in progress is evaluated with the
    /// new parameters. They are not tracked until [`Insole::track`].
    ///
    /// # Errors
    /// If the parameters are damaged or out of range; the previous parameters then remain in force.
    pub fn set_tissue(&mut self, tissue: &Tissue) -> Result<(), TissueError> {
        tissue.check()?;
        self.tissue_id = tissue.id;
        for ((law, live), new) in self.force_laws.iter_mut().zip(&mut self.live).zip(&tissue.force_laws) {
            *law = ForceLaw::of(new);
            live.rebase(law);
        }
        self.tracker.stop();
        Ok(())
    }

    /// Lets the stiffness K and the damping G of the force laws follow the wearer from step to step; see
    /// [`crate::pipeline::track`]. `regions` are those of which the parameters were identified from steps of the wearer: bit i
    /// stands for region i of [`crate::Region::ALL`].
    pub fn track(&mut self, regions: u8) {
        self.tracker.start(&self.force_laws, regions);
    }

    /// The configuration; `None` before [`Insole::set_up`].
    pub fn setup(&self) -> Option<&Setup> {
        (self.setup.period_us > 0).then_some(&self.setup)
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.cells.len()
    }

    /// The identifier of the tissue parameters; 0 without parameters.
    pub fn tissue_id(&self) -> u32 {
        self.tissue_id
    }
}
