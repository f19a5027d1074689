//! The template assigns anatomical landmarks of a foot to their regions.

use plantar::Region;
use plantar::pipeline::template::region_at;
use recording::template::assign;
use recording::{Cell, synthetic};

#[test]
fn landmarks_lie_in_their_regions() {
    // Positions as fractions of the width from the medial side, and of the length from the heel.
    for (x, y, region) in [
        (0.5, 0.05, Region::Heel),
        (0.5, 0.20, Region::Heel),
        (0.8, 0.35, Region::PosteriorMidfoot),
        (0.8, 0.48, Region::AnteriorMidfoot),
        (0.2, 0.56, Region::AnteriorMidfoot),
        // Heads of metatarsals 1, 2, 3 and 5.
        (0.15, 0.73, Region::Metatarsals12),
        (0.40, 0.75, Region::Metatarsals12),
        (0.55, 0.73, Region::Metatarsals35),
        (0.90, 0.63, Region::Metatarsals35),
        (0.20, 0.92, Region::Hallux),
        (0.50, 0.95, Region::Toe2),
        (0.70, 0.90, Region::Toes35),
        (0.95, 0.78, Region::Toes35),
        // A point outside of the outline has the nearest region.
        (-0.2, 1.1, Region::Hallux),
        (1.2, -0.1, Region::Heel),
    ] {
        assert_eq!(region_at(x as f32, y as f32), region, "at {x}, {y}");
    }
}

#[test]
fn regions_hardly_depend_on_the_position_or_the_angle_of_the_foot() {
    let straight = synthetic::insole(1000).cells;
    // The foot is shifted, and sheared by 60 mm over its length. At most 7 % of the cells may change their region.
    let mut oblique: Vec<Cell> = straight
        .iter()
        .map(|cell| Cell { x_mm: cell.x_mm + 500.0 + cell.y_mm * 60.0 / 268.0, y_mm: cell.y_mm - 70.0, ..*cell })
        .collect();
    assign(&mut oblique);
    let same = straight.iter().zip(&oblique).filter(|(a, b)| a.region == b.region).count();
    assert!(same > 930, "{same} of 1000");
}

#[test]
fn a_layout_with_cells_only_at_both_ends_has_regions_and_an_empty_one_is_allowed() {
    let cell = |y_mm| Cell { x_mm: 10.0, y_mm, area_mm2: 100.0, region: Region::Toe2 };
    let mut cells = [cell(5.0), cell(255.0)];
    assign(&mut cells);
    assert_eq!(cells[0].region, Region::Heel);
    assert!(cells[1].region >= Region::Hallux);
    assign(&mut []);
}
