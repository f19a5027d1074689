//! Shows the live loads of the eight regions in the terminal. If stdout is not a terminal, prints one line for each step, load
//! bout and alert instead.

use crate::records::{alert_line, bout_line};
use crate::signals::Signals;
use crate::summary::REGION_LABELS;
use anyhow::Result;
use client::LinkCounters;
use parameters::{DeformationScale, deformation_title};
use plantar::protocol::{Hello, Live, LoadRecord, Step};
use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use ratatui::layout::{Constraint, Layout};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Wrap};
use ratatui::{DefaultTerminal, Frame};
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Shortest time between two redraws.
const REDRAW: Duration = Duration::from_millis(33);
/// Number of the newest steps that the screen lists.
const LISTED: usize = 6;

/// The display of a session.
pub struct View {
    title: String,
    /// The full names of the area and of the deformation, which are shown below the loads.
    column_names: String,
    /// `None` if stdout is not a terminal, or once the display is closed.
    terminal: Option<DefaultTerminal>,
    /// `None` once the display is closed.
    signals: Option<Signals>,
    /// Time of the last redraw.
    last_redraw: Option<Instant>,
    /// The newest live frame.
    live: Live,
    counters: LinkCounters,
    /// Force at the end of the bars' scale, 0.1 N: the largest force so far, but at least 100 N.
    scale_dn: u16,
    steps: Vec<Step>,
    /// The advice of the last alert; empty before the first alert.
    alert: String,
    /// Why the link is lost, and the remedy; empty while there is a link.
    loss: String,
    /// True once the user has ended the session, by a key or a signal.
    has_ended: bool,
}

impl View {
    /// Prints notes about the insole. If stdout is a terminal, switches it to the display; otherwise prints a line with the
    /// title.
    pub fn open(hello: &Hello) -> Result<Self> {
        if let Some(fault) = &hello.fault {
            eprintln!("note: the insole reports a failure: {fault}");
        }
        if hello.tissue_id == 0 {
            eprintln!(
                "note: the insole has no tissue parameters, so it reports no model force and no deformation: send some \
                 with `plantar params push`"
            );
        }
        let terminal = if std::io::stdout().is_terminal() {
            Some(ratatui::try_init()?)
        } else {
            println!("{}", title(hello).trim());
            None
        };
        let mut view = Self::new(hello, terminal);
        view.signals = Some(Signals::catch());
        Ok(view)
    }

    /// The display before the first frame.
    fn new(hello: &Hello, terminal: Option<DefaultTerminal>) -> Self {
        Self {
            title: title(hello),
            column_names: column_names(hello),
            terminal,
            signals: None,
            last_redraw: None,
            live: Live::default(),
            counters: LinkCounters::default(),
            scale_dn: 1000,
            steps: Vec::new(),
            alert: String::new(),
            loss: String::new(),
            has_ended: false,
        }
    }

    /// Shows that the insole answers again after it has sent nothing for some time, and the reason of its last restart, which may
    /// have been the cause.
    pub fn answered_after_silence(&mut self, hello: &Hello) {
        self.column_names = column_names(hello);
        let failure = hello.fault.as_deref().unwrap_or("no failure reported");
        let reset = hello.reset.name();
        let restart = format!("answers again, and may have restarted (last reset: {reset}, {failure})");
        self.title = format!(" the insole {restart} ");
        if self.terminal.is_none() {
            println!("the insole {restart}");
        }
    }

    /// Shows that the link is lost.
    pub fn lost(&mut self, reason: &str) -> Result<()> {
        match self.terminal.take() {
            Some(mut terminal) => {
                self.title = " the link is lost ".into();
                self.loss = reason.into();
                terminal.draw(|frame| self.draw(frame))?;
                self.terminal = Some(terminal);
            }
            None => eprintln!("{reason}"),
        }
        Ok(())
    }

    /// Shows that the link is open again.
    pub fn reconnected(&mut self, hello: &Hello) {
        self.title = title(hello);
        self.loss.clear();
        self.column_names = column_names(hello);
        if self.terminal.is_none() {
            println!("{}", self.title.trim());
        }
    }

    /// Shows a live frame.
    pub fn live(&mut self, live: &Live, counters: LinkCounters) -> Result<()> {
        self.live = *live;
        self.counters = counters;
        for region in &live.regions {
            self.scale_dn = self.scale_dn.max(region.measured_dn).max(region.model_dn);
        }
        let is_due = self.last_redraw.is_none_or(|last| last.elapsed() >= REDRAW);
        if let Some(mut terminal) = self.terminal.take_if(|_| is_due) {
            self.last_redraw = Some(Instant::now());
            terminal.draw(|frame| self.draw(frame))?;
            self.terminal = Some(terminal);
        }
        Ok(())
    }

    /// Lists a step, or shows an alert until the next one and rings the terminal's bell. If stdout is not a terminal, prints the
    /// step, load bout or alert.
    pub fn load_record(&mut self, record: &LoadRecord) {
        match record {
            LoadRecord::Step(step) => self.step(step),
            LoadRecord::Bout(bout) if self.terminal.is_none() => println!("{}", bout_line(bout)),
            LoadRecord::Bout(_) => {}
            LoadRecord::Alert(alert) if self.terminal.is_none() => println!("{}", alert_line(alert)),
            LoadRecord::Alert(alert) => {
                self.alert = client::alert_advice(alert);
                // The session continues even if the bell cannot be written.
                let _ = std::io::stdout().write_all(b"\x07");
            }
        }
    }

    /// Lists a step.
    pub fn step(&mut self, step: &Step) {
        self.steps.push(*step);
        if self.terminal.is_none() {
            println!("{}", step_line(step));
        }
    }

    /// True once q, Esc or Ctrl-C was pressed, or a signal has arrived.
    pub fn wants_to_end(&mut self) -> Result<bool> {
        self.has_ended |= self.signals.as_ref().is_some_and(Signals::have_arrived);
        while self.terminal.is_some() && event::poll(Duration::ZERO)? {
            self.has_ended |= ends_session(&event::read()?);
        }
        Ok(self.has_ended)
    }

    /// Restores the terminal and the effect of signals.
    pub fn close(&mut self) {
        self.signals = None;
        if self.terminal.take().is_some() {
            ratatui::restore();
        }
    }

    fn draw(&self, frame: &mut Frame) {
        // A loss of the link is more urgent than an alert, because no further alert would arrive.
        let (message, lines) = match (self.loss.as_str(), self.alert.as_str()) {
            ("", "") => ("", 0),
            ("", alert) => (alert, 3),
            (loss, _) => (loss, 5),
        };
        // The loads have a header, eight regions and a border. If the terminal is too low for everything, the list of steps is
        // shorter.
        let [loads, steps, message_area, footer] = Layout::vertical([
            Constraint::Length(11),
            Constraint::Max(LISTED as u16 + 2),
            Constraint::Length(lines),
            Constraint::Length(1),
        ])
        .areas(frame.area());
        // A line has 62 characters beside the bar: 2 for the border, 49 for the numbers, and 11 for the longest flag.
        let width = usize::from(loads.width).saturating_sub(62).max(10);
        let mut lines = vec![
            Line::from(format!("{:<10} {:>8} {:>8} {:>9} {:>8}  ", "", "force N", "model N", "area mm2", "deform mm"))
                .dim(),
        ];
        for (i, (name, r)) in REGION_LABELS.iter().zip(&self.live.regions).enumerate() {
            let characters = |dn: u16| usize::from(dn) * width / usize::from(self.scale_dn);
            let (measured, model) = (characters(r.measured_dn), characters(r.model_dn));
            let bar = (0..width).map(|x| match (x < measured, x + 1 == model) {
                (_, true) => Span::styled("|", Style::new().fg(Color::Yellow)),
                (true, _) => Span::styled("█", Style::new().fg(Color::Cyan)),
                _ => Span::raw(" "),
            });
            let is_set = |bits: u8| bits >> i & 1 == 1;
            let flag = match () {
                _ if is_set(self.live.saturated) => "saturated",
                _ if is_set(self.live.masked) => "masked",
                // The contact is larger than the ellipsoid.
                _ if is_set(self.live.clamped) => "> ellipsoid",
                _ => "",
            };
            let numbers = format!(
                "{name:<10} {:>8.1} {:>8.1} {:>9} {:>8.2}  ",
                f64::from(r.measured_dn) / 10.0,
                f64::from(r.model_dn) / 10.0,
                r.area_mm2,
                f64::from(r.deformation_um) / 1000.0
            );
            let spans =
                std::iter::once(Span::raw(numbers)).chain(bar).chain([Span::styled(flag, Style::new().fg(Color::Red))]);
            lines.push(Line::from(spans.collect::<Vec<_>>()));
        }
        frame.render_widget(
            Paragraph::new(lines)
                .block(Block::bordered().title(self.title.as_str()).title_bottom(self.column_names.as_str())),
            loads,
        );
        let listed = self.steps.iter().rev().take(LISTED).map(|step| Line::from(step_line(step))).collect::<Vec<_>>();
        let title = format!(" {} steps, newest first: measured peak force, N ", self.steps.len());
        frame.render_widget(Paragraph::new(listed).block(Block::bordered().title(title)), steps);
        frame.render_widget(Paragraph::new(message).red().bold().wrap(Wrap { trim: true }), message_area);
        let c = &self.counters;
        let text = format!(
            " q: end   {:.2} s   frames: {} received, {} lost   messages: {} damaged   bar: measured, |: model",
            self.live.t_us as f64 / 1e6,
            c.frames_received,
            c.frames_lost,
            c.crc_errors
        );
        frame.render_widget(Paragraph::new(text).dim(), footer);
    }
}

impl Drop for View {
    fn drop(&mut self) {
        self.close();
    }
}

/// True for a key that ends a session: q, Esc or Ctrl-C.
pub fn ends_session(event: &Event) -> bool {
    let Event::Key(key) = event else { return false };
    let control_c = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
    control_c || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc)
}

/// The title of the display: the insole and its firmware.
fn title(hello: &Hello) -> String {
    let rate_hz = 1e6 / f64::from(hello.period_us);
    format!(
        " {} insole, {} cells at {rate_hz:.0} Hz, {} board, firmware {} ",
        hello.side.name(),
        hello.cells,
        hello.board,
        hello.firmware
    )
}

/// The full names of the area and of the deformation, for which the headers of the columns have no space. An insole does not
/// know whether the scale of its deformation was measured, so the name states that it is assumed.
fn column_names(hello: &Hello) -> String {
    let (area, deformation) =
        (recording::area_title(&hello.contact_rule), deformation_title(&DeformationScale::ALL_ASSUMED));
    format!(" area: {area}; deform: {deformation} ")
}

/// A line with a step's number, its times, and the measured peak force of each region, N.
fn step_line(step: &Step) -> String {
    let peaks: Vec<_> = REGION_LABELS
        .iter()
        .zip(&step.regions)
        .map(|(name, r)| format!("{name} {:.0}", f64::from(r.measured_peak_dn) / 10.0))
        .collect();
    format!(
        "step {} at {:.2} s, stance {:.2} s: {}",
        step.step,
        step.start_us as f64 / 1e6,
        f64::from(step.duration_us) / 1e6,
        peaks.join("  ")
    )
}

#[cfg(test)]
mod tests {
    use super::View;
    use plantar::protocol::Live;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    #[test]
    fn no_flag_is_cut_off_in_a_terminal_of_80_columns() {
        let mut view = View::new(&testkit::hello(), None);
        view.live = Live { saturated: 1, masked: 2, clamped: 4, ..Live::default() };
        let mut terminal = Terminal::new(TestBackend::new(80, 24)).expect("a terminal");
        terminal.draw(|frame| view.draw(frame)).expect("a picture");
        let screen = terminal.backend().to_string();
        for flag in ["saturated", "masked", "> ellipsoid"] {
            assert!(screen.contains(flag), "{flag}: {screen}");
        }
    }

    #[test]
    fn the_remedy_for_a_lost_link_is_not_cut_off_in_a_terminal_of_80_columns() {
        let mut view = View::new(&testkit::hello(), None);
        view.alert = "unload the heel".into();
        let remedy = "which must be closed first; trying again";
        view.loss =
            format!("{} {remedy}", "no answer arrived within 2 s, and the cause is explained in many words".repeat(4));
        let mut terminal = Terminal::new(TestBackend::new(80, 24)).expect("a terminal");
        terminal.draw(|frame| view.draw(frame)).expect("a picture");
        // A line may break between two words.
        let screen = terminal.backend().to_string().replace(|c: char| !c.is_ascii_alphanumeric(), "");
        assert!(screen.contains(&remedy.replace(|c: char| !c.is_ascii_alphanumeric(), "")), "{screen}");
        assert!(screen.contains("qend"), "{screen}");
    }
}
