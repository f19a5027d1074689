//! The messages of a guided session, and the fit of one foot.

use fit::live::LiveSteps;
use fit::steps::ExclusionReason;
use fit::{Options, Study, results};
use parameters::InsoleSize;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::{Hello, MAJOR, MAX_MESSAGE, ToDevice, ToHost, decode, encode};
use plantar::{Region, Side};
use serde_json::{Value, json};

/// The request that sends the parameters of a study to an insole, encoded.
fn set_tissue(study: &Study, size: InsoleSize) -> Vec<u8> {
    let parameters = results::parameters(study, size);
    let tissue = parameters.tissue();
    // `on_insole` fails only for the filter `smoothed`, which this session does not use.
    let identified = parameters.identified.as_ref().and_then(|identified| identified.on_insole().ok());
    let message = match identified {
        Some(identified) => ToDevice::SetIdentifiedTissue { tissue, identified },
        None => ToDevice::SetTissue(tissue),
    };
    let mut buffer = [0; MAX_MESSAGE];
    // Every request fits into the buffer.
    encode(&message, &mut buffer).map_or(Vec::new(), |message| message.to_vec())
}

/// The messages of one or two insoles.
#[derive(Default)]
pub struct Session {
    insoles: [Insole; 2],
}

/// The messages of one insole.
#[derive(Default)]
struct Insole {
    hello: Option<Hello>,
    steps: LiveSteps,
}

impl Session {
    /// Adds an encoded message of the insole with this index. Returns true if it is a step. Messages that a fit does not use,
    /// messages of an insole of another major version, and other bytes are ignored.
    pub fn add(&mut self, insole: usize, message: &[u8]) -> bool {
        let Some(insole) = self.insoles.get_mut(insole) else { return false };
        let has_same_version = insole.hello.as_ref().is_none_or(|hello| hello.major == MAJOR);
        match decode::<ToHost>(message) {
            Some(ToHost::Hello(hello)) => {
                insole.steps.session_started();
                insole.hello = Some(hello);
            }
            Some(ToHost::Live(live)) if has_same_version => insole.steps.frame(&live),
            Some(ToHost::Step(step)) if has_same_version => {
                insole.steps.step(&step);
                return true;
            }
            _ => (),
        }
        false
    }

    /// For each insole: its foot, its frame rate, the number of usable steps, whether it seems to lie under the other foot, and
    /// the number of excluded contacts by reason.
    pub fn collected(&self) -> Value {
        self.insoles.iter().map(Insole::collected).collect()
    }

    /// Fits the parameters to the steps of one insole. `progress` receives each region when its fit is complete.
    ///
    /// The result has the form of the JSON of `plantar fit`, with four more entries: `message`, the bytes of the request that
    /// sends the parameters to the insole, `tissue_id`, the identifier by which the insole confirms them, `parameters`, the text
    /// of the parameter file, and `fitted`, the number of fitted regions. It has the entry `error` instead if there is no such
    /// insole, or if its steps were measured with different contact rules.
    pub fn identify(&mut self, insole: usize, size: InsoleSize, progress: &(dyn Fn(Region) + Sync)) -> Value {
        let Some(insole) = self.insoles.get_mut(insole) else { return json!({ "error": "There is no such insole." }) };
        insole.steps.finish();
        let contact = insole.steps.contact_rules().first().copied().unwrap_or(ContactRule::COUNTED);
        // Without resamples, unlike `plantar fit`: they would take ten times as long as the rest of the fit.
        let mut study = Study::new("wearer".into(), contact, Options::usual(size.thickness_m()));
        let name = insole.side().name().to_string();
        if let Err(error) = study.add_live(name, "Guided session on the page.".into(), insole.side(), &insole.steps) {
            return json!({ "error": format!("{error}. Start again.") });
        }
        study.fit(progress);
        let mut result = results::to_json(&study);
        result["fitted"] = study.fits.iter().flatten().count().into();
        result["tissue_id"] = results::parameters(&study, size).tissue().id.into();
        result["message"] = set_tissue(&study, size).into();
        result["parameters"] = results::to_toml(&study, size).into();
        result
    }
}

impl Insole {
    /// The foot by the steps, or otherwise by the hello; right if neither has arrived.
    fn side(&self) -> Side {
        self.steps.side().or(self.hello.as_ref().map(|hello| hello.side)).unwrap_or(Side::Right)
    }

    /// See [`Session::collected`].
    fn collected(&self) -> Value {
        let (steps, excluded) = self.steps.collected(0);
        let count = |is_reason: fn(&ExclusionReason) -> bool| excluded.iter().filter(|e| is_reason(&e.reason)).count();
        json!({
            "side": self.side().name(),
            "rate_hz": self.steps.rate_hz(),
            "good": steps.len(),
            "mirrored": self.steps.looks_mirrored(),
            "excluded": {
                "broken": count(|reason| matches!(reason, ExclusionReason::Broken)),
                "partial": count(|reason| matches!(reason, ExclusionReason::Partial(_))),
                "before": count(|reason| {
                    matches!(reason, ExclusionReason::BeforeRestart | ExclusionReason::BeforeStream)
                }),
            },
        })
    }
}
