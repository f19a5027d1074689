//! The picture has the expected size and is not blank.

mod common;

use common::{STUDY, empty};
use resvg::tiny_skia::Pixmap;
use std::collections::HashSet;

#[test]
#[ignore = "needs a font for the text: cargo xtask test"]
fn pictures_are_large_and_not_blank() {
    for study in [&STUDY, &empty()] {
        let png = report::png(study).expect("a picture");
        let picture = Pixmap::decode_png(&png).expect("a valid PNG");
        assert!((1500..4000).contains(&picture.width()), "{} wide", picture.width());
        assert!((1500..4000).contains(&picture.height()), "{} high", picture.height());
        let colours: HashSet<_> = picture.pixels().iter().map(|p| (p.red(), p.green(), p.blue())).collect();
        assert!(colours.len() > 100, "{} colours", colours.len());
        assert!(picture.pixels().iter().all(|pixel| pixel.alpha() == 255));
    }
}
