//! A study of a computed walk of both feet. One region is never loaded, and one is hardly loaded.
#![allow(dead_code, reason = "each test uses a part of it")]

use fit::{Options, Study};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::{Region, Side};
use recording::synthetic::{SyntheticWalk, walk};
use recording::{Recording, VirtualInsole};
use std::sync::LazyLock;

pub const TITLES: [&str; 8] = [
    "Heel",
    "Posterior midfoot",
    "Anterior midfoot",
    "Metatarsals 1–2",
    "Metatarsals 3–5",
    "Hallux",
    "Toe 2",
    "Toes 3–5",
];

/// A name that would break the page if it were not escaped.
pub const PARTICIPANT: &str = "<script>alert('P & 1')</script>";
pub const FILE: &str = "\"left\" <i>walk</i>.parquet";

pub static STUDY: LazyLock<Study> = LazyLock::new(|| {
    let mut study = empty();
    add(&mut study, FILE, &recorded(Side::Left));
    // In this recording, the heel strike of the first step is missing.
    let mut right = recorded(Side::Right);
    let cut = 60 * right.cells();
    right.pressure_kpa.drain(..cut);
    right.t_s.truncate(right.t_s.len() - 60);
    add(&mut study, "right.parquet", &right);
    study.fit(&|_| ());
    study
});

pub fn empty() -> Study {
    let thickness_m = [0.016, 0.012, 0.012, 0.012, 0.010, 0.010, 0.007, 0.007];
    let options = Options { resamples: 50, ..Options::usual(thickness_m) };
    Study::new(PARTICIPANT.into(), ContactRule::COUNTED, options)
}

fn add(study: &mut Study, name: &str, recording: &Recording) {
    let insole = VirtualInsole::new(recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    study.add(name.into(), recording, &insole, &mut |_| ()).expect("a valid insole");
}

fn recorded(side: Side) -> Recording {
    let mut recording =
        walk(&SyntheticWalk { side, steps: 4, seed: side as u64, ..SyntheticWalk::default() }).recording;
    let regions: Vec<Region> = recording.layout.cells.iter().map(|cell| cell.region).collect();
    for frame in recording.pressure_kpa.chunks_exact_mut(regions.len()) {
        for (kpa, region) in frame.iter_mut().zip(&regions) {
            match region {
                Region::Toe2 => *kpa = 0.0,
                Region::PosteriorMidfoot => *kpa *= 0.06,
                _ => (),
            }
        }
    }
    recording
}
