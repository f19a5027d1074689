//! Reduction of a recording to fewer cells with the same load.

use crate::{Cell, Error, Layout, Recording, Result};
use plantar::Region;
use plantar::pipeline::region::MAX_CELL_MM2;
use std::collections::BTreeMap;

/// Step between the grid pitches that the search tries, mm. The pitch is the side of the grid's squares.
const PITCH_STEP_MM: f64 = 0.1;

/// See [`Recording::binned`].
pub fn binned(recording: &Recording, max_cells: usize) -> Result<Recording> {
    if recording.cells() <= max_cells {
        return Ok(recording.clone());
    }
    let loaded = loaded_cells(recording);
    let cells = &recording.layout.cells;
    // If no cell was dropped, perhaps none carries load.
    let kind = if loaded.len() < cells.len() { "loaded " } else { "" };
    if loaded.len() <= max_cells {
        let groups: Vec<_> = loaded.iter().map(|&i| vec![i]).collect();
        let processing = format!("Reduced to the {} cells that carry load in some frame.", groups.len());
        return Ok(merged(recording, &groups, &processing));
    }
    let regions = Region::ALL.into_iter().filter(|&region| loaded.iter().any(|&i| cells[i].region == region)).count();
    if max_cells < regions {
        return Err(Error::content(
            "reduction to fewer cells",
            format!("{regions} {kind}regions do not fit into {max_cells} cells"),
            format!("allow at least {regions} cells"),
        ));
    }
    let (pitch_mm, groups) = (1u32..)
        .map(|k| f64::from(k) * PITCH_STEP_MM)
        .map(|pitch_mm| (pitch_mm, squares(cells, &loaded, pitch_mm)))
        .find(|(_, groups)| groups.len() <= max_cells)
        .expect("with a square as large as the foot one cell for each region is left, and max_cells is at least their number");
    let processing = format!(
        "Merged {} {kind}cells into {} on a {pitch_mm:.1} mm grid within each region.",
        loaded.len(),
        groups.len()
    );
    let merged = merged(recording, &groups, &processing);
    let largest_mm2 = merged.layout.cells.iter().map(|cell| cell.area_mm2).fold(0.0, f64::max);
    if largest_mm2 > f64::from(MAX_CELL_MM2) {
        return Err(Error::content(
            "reduction to fewer cells",
            format!("a merged cell would have {largest_mm2:.0} mm², but a cell has at most {MAX_CELL_MM2} mm²"),
            "allow more cells",
        ));
    }
    Ok(merged)
}

/// The indices of the cells that carry load in at least one frame. If no cell ever carries load, the indices of all cells.
fn loaded_cells(recording: &Recording) -> Vec<usize> {
    let cells = recording.cells();
    let mut are_loaded = vec![false; cells];
    for frame in recording.pressure_kpa.chunks_exact(cells) {
        for (is_loaded, &kpa) in are_loaded.iter_mut().zip(frame) {
            *is_loaded |= kpa > 0.0;
        }
    }
    if !are_loaded.contains(&true) {
        return (0..cells).collect();
    }
    (0..cells).filter(|&i| are_loaded[i]).collect()
}

/// Groups the chosen cells: the cells of one region in one square of a grid form a group. The grid begins at the smallest
/// coordinates of these cells. The groups are ordered from heel to toes.
fn squares(cells: &[Cell], chosen: &[usize], pitch_mm: f64) -> Vec<Vec<usize>> {
    let least = |along: fn(&Cell) -> f64| chosen.iter().map(|&i| along(&cells[i])).fold(f64::INFINITY, f64::min);
    let (x0_mm, y0_mm) = (least(|c| c.x_mm), least(|c| c.y_mm));
    let mut groups = BTreeMap::<_, Vec<usize>>::new();
    for &i in chosen {
        let cell = &cells[i];
        let row = ((cell.y_mm - y0_mm) / pitch_mm) as u64;
        let column = ((cell.x_mm - x0_mm) / pitch_mm) as u64;
        groups.entry((row, column, cell.region)).or_default().push(i);
    }
    groups.into_values().collect()
}

/// Merges each group of cells into one cell. `processing` is a sentence that is added to the provenance.
fn merged(recording: &Recording, groups: &[Vec<usize>], processing: &str) -> Recording {
    let cells = &recording.layout.cells;
    let merged_cells: Vec<Cell> = groups
        .iter()
        .map(|group| {
            let area_mm2: f64 = group.iter().map(|&i| cells[i].area_mm2).sum();
            let mean = |along: fn(&Cell) -> f64| {
                group.iter().map(|&i| along(&cells[i]) * cells[i].area_mm2).sum::<f64>() / area_mm2
            };
            Cell { x_mm: mean(|c| c.x_mm), y_mm: mean(|c| c.y_mm), area_mm2, region: cells[group[0]].region }
        })
        .collect();
    let mut pressure_kpa = Vec::with_capacity(recording.frames() * groups.len());
    for frame in recording.pressure_kpa.chunks_exact(cells.len()) {
        for (group, cell) in groups.iter().zip(&merged_cells) {
            let force_mn: f64 = group.iter().map(|&i| f64::from(frame[i]) * cells[i].area_mm2).sum();
            pressure_kpa.push((force_mn / cell.area_mm2) as f32);
        }
    }
    Recording {
        side: recording.side,
        layout: Layout {
            name: format!("{}, {} cells", recording.layout.name, groups.len()),
            cells: merged_cells,
            sheet: None,
        },
        rate_hz: recording.rate_hz,
        source: format!("{} {processing}", recording.source),
        t_s: recording.t_s.clone(),
        pressure_kpa,
    }
}
