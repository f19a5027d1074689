//! The screen of a guided session: an instruction, the progress of each foot, and the loads of the soles. If stdout is not a
//! terminal, instructions, counts and remarks are printed as lines.

use crate::signals::Signals;
use crate::view::ends_session;
use anyhow::Result;
use plantar::Side;
use plantar::pipeline::outline::GENERIC_SOLE;
use plantar::pipeline::template::region_at;
use plantar::protocol::Live;
use ratatui::crossterm::event::{self, Event, KeyCode};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::canvas::{Canvas, Points};
use ratatui::widgets::{Block, Gauge, Paragraph, Wrap};
use ratatui::{DefaultTerminal, Frame};
use std::io::IsTerminal;
use std::time::Duration;

/// Longest time between two pictures.
const REDRAW: Duration = Duration::from_millis(50);
/// Spacing of the points that draw a sole, mm.
const GRID_MM: f64 = 4.0;
/// Force of a region, 0.1 N, at the upper end of the scale of [`COLOURS`].
const FULL_DN: f64 = 3000.0;
/// Colours of the points, from unloaded to fully loaded; indices of the 256 colours of a terminal.
const COLOURS: [u8; 6] = [236, 24, 31, 37, 214, 203];

/// What the user requests by a key or a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// Nothing.
    None,
    /// To begin the next part of the session: Enter.
    Begin,
    /// To end the session.
    End,
}

impl Input {
    /// The meaning of an event of the terminal.
    fn of(event: &Event) -> Self {
        match event {
            _ if ends_session(event) => Self::End,
            // Some terminals report the release of a key, too: also that of the Enter which started this program.
            Event::Key(key) if key.code == KeyCode::Enter && key.is_press() => Self::Begin,
            _ => Self::None,
        }
    }
}

/// True if a person can press keys: stdin is a terminal.
pub fn has_keyboard() -> bool {
    std::io::stdin().is_terminal()
}

/// The state of a foot that the screen shows.
#[derive(Clone, Debug)]
pub struct Progress {
    /// The foot.
    pub side: Side,
    /// The newest live frame.
    pub live: Live,
    /// Number of steps so far that count in this part of the session; for the walk, the good steps, including those of earlier
    /// sessions.
    pub done: usize,
    /// Number of such steps at which this part of the session ends; 0 if it counts no steps.
    pub needed: usize,
    /// The latest remark, such as the reason why a step is not used, or that the link is lost; empty without one.
    pub remark: String,
}

impl Progress {
    /// The progress before the first frame.
    pub fn new(side: Side) -> Self {
        Self { side, live: Live::default(), done: 0, needed: 0, remark: String::new() }
    }

    /// True in a part of the session for which the wearer walks: it counts steps.
    pub fn is_walking(&self) -> bool {
        self.needed > 0
    }

    /// Measured force on the foot, N.
    pub fn force_n(&self) -> f64 {
        self.live.regions.iter().map(|region| region.measured_force_n()).sum()
    }
}

/// The screen.
pub struct Screen {
    /// `None` if stdout is not a terminal.
    terminal: Option<DefaultTerminal>,
    signals: Signals,
    /// The lines of the last picture, if stdout is not a terminal. Of the next picture, only the lines that are not among them
    /// are printed.
    printed: Vec<String>,
}

impl Screen {
    /// Switches the terminal to the screen, if stdout is a terminal.
    pub fn open() -> Result<Self> {
        let terminal = if std::io::stdout().is_terminal() { Some(ratatui::try_init()?) } else { None };
        Ok(Self { terminal, signals: Signals::catch(), printed: Vec::new() })
    }

    /// Shows the instruction and the feet, and waits until a key is pressed or the next picture is due. Returns what the key or a
    /// signal requests.
    pub fn show(&mut self, instruction: &str, feet: &[Progress]) -> Result<Input> {
        let has_keys = self.terminal.is_some() || has_keyboard();
        match &mut self.terminal {
            Some(terminal) => _ = terminal.draw(|frame| draw(frame, instruction, feet))?,
            None => self.print(instruction, feet),
        }
        let mut input = Input::None;
        if !has_keys {
            std::thread::sleep(REDRAW);
        } else if event::poll(REDRAW)? {
            input = Input::of(&event::read()?);
        }
        Ok(if self.signals.have_arrived() { Input::End } else { input })
    }

    /// Prints the lines that have changed.
    fn print(&mut self, instruction: &str, feet: &[Progress]) {
        let counts = feet
            .iter()
            .filter(|foot| foot.needed > 0)
            .map(|foot| format!("{}: {} of {}", foot.side.name(), foot.done, foot.needed));
        let remarks = feet.iter().filter(|foot| !foot.remark.is_empty());
        let remarks = remarks.map(|foot| format!("{}: {}", foot.side.name(), foot.remark));
        let lines: Vec<String> = std::iter::once(instruction.to_string()).chain(counts).chain(remarks).collect();
        for line in lines.iter().filter(|line| !self.printed.contains(line)) {
            println!("{line}");
        }
        self.printed = lines;
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        if self.terminal.take().is_some() {
            ratatui::restore();
        }
    }
}

fn draw(frame: &mut Frame, instruction: &str, feet: &[Progress]) {
    let areas = Layout::vertical([Constraint::Length(5), Constraint::Min(10), Constraint::Length(1)]);
    let [above, middle, below] = areas.areas(frame.area());
    let text = Paragraph::new(Line::from(instruction).bold()).centered().wrap(Wrap { trim: true });
    frame.render_widget(text.block(Block::bordered().title(" Identification ")), above);
    // The left foot is on the left, as the wearer sees it.
    let mut sorted: Vec<&Progress> = feet.iter().collect();
    sorted.sort_by_key(|foot| foot.side as u8);
    let columns = Layout::horizontal(sorted.iter().map(|_| Constraint::Fill(1))).split(middle);
    for (foot, area) in sorted.into_iter().zip(columns.iter()) {
        draw_foot(frame, foot, *area);
    }
    let footer = "q: interrupt; the same command continues later";
    frame.render_widget(Paragraph::new(footer).dim().centered(), below);
}

fn draw_foot(frame: &mut Frame, foot: &Progress, area: Rect) {
    let areas =
        Layout::vertical([Constraint::Min(8), Constraint::Length(1), Constraint::Length(1), Constraint::Length(5)]);
    let [sole, force, gauge, remark] = areas.areas(area);
    draw_sole(frame, foot, sole);
    let text = format!("{} foot  {:.0} N", foot.side.name(), foot.force_n());
    frame.render_widget(Paragraph::new(text).centered(), force);
    if foot.needed > 0 {
        let ratio = (foot.done as f64 / foot.needed as f64).min(1.0);
        let label = format!("{} of {}", foot.done, foot.needed);
        frame.render_widget(Gauge::default().ratio(ratio).label(label).gauge_style(Color::Green), gauge);
    }
    let text = Paragraph::new(foot.remark.as_str()).style(Style::new().fg(Color::Yellow)).centered();
    frame.render_widget(text.wrap(Wrap { trim: true }), remark);
}

/// Draws the sole as points, in the colours of the forces of their regions.
fn draw_sole(frame: &mut Frame, foot: &Progress, area: Rect) {
    let (length_mm, width_mm) = (GENERIC_SOLE.length_mm(), GENERIC_SOLE.width_mm());
    let mut by_colour: [Vec<(f64, f64)>; COLOURS.len()] = Default::default();
    let rows = (length_mm / GRID_MM) as usize;
    for row in 0..=rows {
        let y_mm = row as f64 * GRID_MM;
        let [medial_mm, lateral_mm] = GENERIC_SOLE.edges_mm(y_mm);
        let columns = ((lateral_mm - medial_mm) / GRID_MM) as usize;
        for column in 0..=columns {
            let x_mm = medial_mm + column as f64 * GRID_MM;
            let fraction = (x_mm - medial_mm) / (lateral_mm - medial_mm);
            let region = region_at(fraction as f32, (y_mm / length_mm) as f32);
            let share = f64::from(foot.live.regions[region as usize].measured_dn) / FULL_DN;
            let colour = (share * (COLOURS.len() - 1) as f64).ceil() as usize;
            // x increases to the lateral side, which is on the left of a left foot.
            let x_mm = if foot.side == Side::Left { width_mm - x_mm } else { x_mm };
            by_colour[colour.min(COLOURS.len() - 1)].push((x_mm, y_mm));
        }
    }
    // A character is about twice as high as wide. The scale is the same in both directions, so the foot is not distorted.
    let shown_mm =
        (length_mm + 2.0 * GRID_MM).max(width_mm * f64::from(area.height) * 2.0 / f64::from(area.width.max(1)));
    let middle_mm = width_mm / 2.0;
    let half_mm = shown_mm * f64::from(area.width) / f64::from(area.height.max(1)) / 4.0;
    let canvas = Canvas::default()
        .marker(Marker::HalfBlock)
        .x_bounds([middle_mm - half_mm, middle_mm + half_mm])
        .y_bounds([-GRID_MM, shown_mm - GRID_MM])
        .paint(|context| {
            for (points, colour) in by_colour.iter().zip(COLOURS) {
                context.draw(&Points { coords: points, color: Color::Indexed(colour) });
            }
        });
    frame.render_widget(canvas, area);
}

#[cfg(test)]
mod tests {
    use super::Input;
    use ratatui::crossterm::event::{Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

    #[test]
    fn only_enter_begins_a_part_and_only_when_it_is_pressed() {
        let key = |code| KeyEvent::new(code, KeyModifiers::NONE);
        let released = KeyEvent { kind: KeyEventKind::Release, ..key(KeyCode::Enter) };
        for (event, input) in [
            (Event::Key(key(KeyCode::Enter)), Input::Begin),
            (Event::Key(released), Input::None),
            (Event::Key(key(KeyCode::Char('x'))), Input::None),
            (Event::Resize(80, 24), Input::None),
            (Event::Key(key(KeyCode::Char('q'))), Input::End),
        ] {
            assert_eq!(Input::of(&event), input, "{event:?}");
        }
    }
}
