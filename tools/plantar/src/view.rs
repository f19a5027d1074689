//! Shows the live loads of the eight regions in the terminal. If stdout is not a terminal, prints one line for each step, load
//! bout and alert instead.

use crate::records::{alert_line, bout_line};
use crate::signals::Signals;
use crate::summary::REGION_LABELS;
use anyhow::Result;
use client::{LinkCounters, Meanwhile};
use parameters::{DeformationScale, deformation_title};
use plantar::protocol::{Hello, Live, LoadRecord, Step};
use ratatui::buffer::Buffer;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use ratatui::layout::{Constraint, Layout};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Paragraph, Widget, Wrap};
use ratatui::{DefaultTerminal, Frame};
use std::collections::VecDeque;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Shortest time between two redraws.
const REDRAW: Duration = Duration::from_millis(33);
/// Largest number of steps that the screen lists; few terminals have lines for as many.
const LISTED: usize = 100;
/// An alert is shown until it has this age, as on the page; an older one is no present advice.
const FRESH: Duration = Duration::from_secs(300);

/// The notice if the insole answers and has no frames.
const NO_FRAMES: &str = "the insole answers, but measures no frames, because its sensor matrix does not answer: check the matrix \
                         and its converter";

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
    /// The newest steps, at most [`LISTED`], newest first.
    steps: VecDeque<Step>,
    /// Number of steps so far.
    step_count: usize,
    /// The advice of the last alert, and when it ends.
    alert: Option<(String, Instant)>,
    /// Why the link is lost, and the remedy; or why the insole sent no frames before it answered again; otherwise empty.
    notice: String,
    /// A note about the session; empty if there is none.
    note: String,
    /// True if the notice is [`NO_FRAMES`], which a frame removes.
    has_no_frames: bool,
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
            steps: VecDeque::new(),
            step_count: 0,
            alert: None,
            notice: String::new(),
            note: String::new(),
            has_no_frames: false,
            has_ended: false,
        }
    }

    /// Shows why the insole sent no frames before it answered again: a restart, with its reason, or its matrix, which does not
    /// answer. If neither is known, shows that the insole has not restarted.
    pub fn answered_after_silence(&mut self, hello: &Hello, meanwhile: Meanwhile) {
        self.column_names = column_names(hello);
        let failure = hello.fault.as_deref().unwrap_or("no failure reported");
        let reset = hello.reset.name();
        let notice = match meanwhile {
            Meanwhile::Restarted => format!("the insole has restarted (last reset: {reset}, {failure})"),
            Meanwhile::NoFrames => NO_FRAMES.into(),
            Meanwhile::Frames => "the insole sent no frames for 2 s, and has not restarted".into(),
        };
        // A matrix that does not answer causes a new session every two seconds.
        let has_no_frames = meanwhile == Meanwhile::NoFrames;
        if self.terminal.is_none() && !(has_no_frames && self.has_no_frames) {
            println!("{notice}");
        }
        self.has_no_frames = has_no_frames;
        self.notice = notice;
    }

    /// Shows that the link is lost.
    pub fn lost(&mut self, reason: &str) -> Result<()> {
        if self.terminal.is_none() {
            eprintln!("{reason}");
        }
        self.title = " the link is lost ".into();
        self.has_no_frames = false;
        self.notice = reason.into();
        self.redraw()
    }

    /// Shows a note about the session, which remains until the display is closed, and is then printed.
    pub fn note(&mut self, note: String) -> Result<()> {
        if self.terminal.is_none() {
            eprintln!("note: {note}");
        }
        self.note = note;
        self.redraw()
    }

    /// Draws the display if stdout is a terminal.
    fn redraw(&mut self) -> Result<()> {
        if let Some(mut terminal) = self.terminal.take() {
            terminal.draw(|frame| self.draw(frame))?;
            self.terminal = Some(terminal);
        }
        Ok(())
    }

    /// Shows that the link is open again.
    pub fn reconnected(&mut self, hello: &Hello) {
        self.title = title(hello);
        self.has_no_frames = false;
        self.notice.clear();
        self.column_names = column_names(hello);
        if self.terminal.is_none() {
            println!("{}", self.title.trim());
        }
    }

    /// Shows a live frame.
    pub fn live(&mut self, live: &Live, counters: LinkCounters) -> Result<()> {
        self.live = *live;
        if self.has_no_frames {
            self.has_no_frames = false;
            self.notice.clear();
        }
        self.counters = counters;
        for region in &live.regions {
            self.scale_dn = self.scale_dn.max(region.measured_dn).max(region.model_dn);
        }
        if self.last_redraw.is_some_and(|last| last.elapsed() < REDRAW) {
            return Ok(());
        }
        self.last_redraw = Some(Instant::now());
        self.redraw()
    }

    /// Lists a step; shows an alert that began less than five minutes ago, and rings the terminal's bell. If stdout is not a
    /// terminal, prints the step, load bout or alert. `age` is the time since the start of the record; `None` if it is unknown.
    pub fn load_record(&mut self, record: &LoadRecord, age: Option<Duration>) {
        match record {
            LoadRecord::Step(step) => self.step(step),
            LoadRecord::Bout(bout) if self.terminal.is_none() => println!("{}", bout_line(bout)),
            LoadRecord::Bout(_) => {}
            LoadRecord::Alert(alert) => {
                let remaining = age.and_then(|age| FRESH.checked_sub(age));
                if self.terminal.is_none() {
                    let when = match (remaining, age) {
                        (Some(_), _) => String::new(),
                        (None, Some(age)) => format!("{} ago: ", age_text(age)),
                        (None, None) => "at an unknown time: ".into(),
                    };
                    println!("{when}{}", alert_line(alert));
                } else if remaining.is_some() {
                    // The session continues even if the bell cannot be written.
                    let _ = std::io::stdout().write_all(b"\x07");
                }
                if let Some(remaining) = remaining {
                    self.alert = Some((client::alert_advice(alert), Instant::now() + remaining));
                }
            }
        }
    }

    /// Lists a step.
    pub fn step(&mut self, step: &Step) {
        self.steps.push_front(*step);
        self.steps.truncate(LISTED);
        self.step_count += 1;
        if self.terminal.is_none() {
            println!("{}", step_line(step));
        }
    }

    /// True once q, Esc or Ctrl-C was pressed, or a signal has arrived. To be called repeatedly: also removes an alert that is no
    /// longer fresh.
    pub fn wants_to_end(&mut self) -> Result<bool> {
        if self.alert.take_if(|(_, end)| *end <= Instant::now()).is_some() {
            self.redraw()?;
        }
        self.has_ended |= self.signals.as_ref().is_some_and(Signals::have_arrived);
        while self.terminal.is_some() && event::poll(Duration::ZERO)? {
            self.has_ended |= ends_session(&event::read()?);
        }
        Ok(self.has_ended)
    }

    /// Restores the terminal and the default handling of signals.
    pub fn close(&mut self) {
        self.signals = None;
        if self.terminal.take().is_some() {
            ratatui::restore();
            if !self.note.is_empty() {
                eprintln!("note: {}", self.note);
            }
        }
    }

    fn draw(&self, frame: &mut Frame) {
        // The loss of the link comes first: it is more urgent than an alert, because no further alert would arrive.
        let alert = self.alert.as_ref().map_or("", |(advice, _)| advice);
        let urgent = Style::new().red().bold();
        let parts = [(self.notice.as_str(), urgent), (alert, urgent), (&self.note, Style::new())];
        let lines = parts.into_iter().flat_map(|(text, style)| text.lines().map(move |line| Line::styled(line, style)));
        let message = Paragraph::new(lines.collect::<Vec<_>>()).wrap(Wrap { trim: true });
        // A draft shows how many lines the message needs.
        let mut draft = Buffer::empty(frame.area());
        (&message).render(draft.area, &mut draft);
        let last_character = draft.content.iter().rposition(|cell| cell.symbol() != " ");
        let lines = last_character.map_or(0, |last| last / usize::from(draft.area.width) + 1);
        // The loads have a header, eight regions and a border. The list of steps has the remaining lines.
        let [loads, steps, message_area, footer] = Layout::vertical([
            Constraint::Length(11),
            Constraint::Fill(1),
            Constraint::Length(lines as u16),
            Constraint::Length(1),
        ])
        .areas(frame.area());
        // A line has 62 characters beside the bar: 2 for the border, 49 for the numbers, and 11 for the longest flag.
        let width = usize::from(loads.width).saturating_sub(62).max(10);
        let mut lines = vec![
            Line::from(format!(
                "{:<10} {:>8} {:>8} {:>8} {:>9}  bar: measured, |: model",
                "", "force N", "model N", "area mm2", "deform mm"
            ))
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
                "{name:<10} {:>8.1} {:>8.1} {:>8} {:>9.2}  ",
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
        // A step needs 79 characters. The full labels would need eight more.
        let labels = REGION_LABELS.map(|label| label.replace("midfoot", "mid"));
        let header = format!("{:>7} {:>9} {:>6} {}", "step", "start", "stance", labels.join(" "));
        let rows = self.steps.iter().map(|step| {
            let peaks = labels.iter().zip(&step.regions);
            let peaks: Vec<_> =
                peaks.map(|(label, r)| format!("{:>1$.0}", r.measured_force_peak_n(), label.len())).collect();
            let (start_s, stance_s) = (step.start_s(), step.duration_s());
            Line::from(format!("{:>7} {start_s:>9.1} {stance_s:>6.2} {}", step.step, peaks.join(" ")))
        });
        let list: Vec<_> = std::iter::once(Line::from(header).dim()).chain(rows).collect();
        let title = format!(" steps: {}, newest first; times in s, measured peak forces in N ", self.step_count);
        frame.render_widget(Paragraph::new(list).block(Block::new().borders(Borders::TOP).title(title)), steps);
        frame.render_widget(message, message_area);
        let c = &self.counters;
        let text = format!(
            " q: end  time {:.0} s  frames: {} received, {} lost  messages: {} damaged",
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

/// An age in minutes up to two hours, then in hours up to two days, then in days.
fn age_text(age: Duration) -> String {
    match age.as_secs() / 60 {
        minutes if minutes <= 120 => format!("{minutes} min"),
        minutes if minutes <= 2880 => format!("{} h", minutes / 60),
        minutes => format!("{} days", minutes / 1440),
    }
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
    use super::*;
    use plantar::protocol::{Alert, MAX_FAULT_TEXT};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    /// The display before the first frame.
    fn view() -> View {
        View::new(&testkit::hello(), None)
    }

    /// The alert with the longest advice.
    fn longest_alert() -> Alert {
        Alert { sustained: 0xff, dose: 0xff, ..testkit::alert(0) }
    }

    /// Shows the alert with the longest advice. Returns this advice.
    fn show_longest_alert(view: &mut View) -> String {
        view.load_record(&LoadRecord::Alert(longest_alert()), Some(Duration::ZERO));
        client::alert_advice(&longest_alert())
    }

    /// What a terminal of 80 columns and 24 lines shows.
    fn screen(view: &View) -> String {
        let mut terminal = Terminal::new(TestBackend::new(80, 24)).expect("a terminal");
        terminal.draw(|frame| view.draw(frame)).expect("a picture");
        let screen = terminal.backend().to_string().replace('"', "");
        println!("{screen}");
        screen
    }

    /// True if the screen shows all words of a text. A line may break between two words.
    fn shows(screen: &str, text: &str) -> bool {
        let words = |text: &str| text.replace(|c: char| !c.is_ascii_alphanumeric(), "");
        words(screen).contains(&words(text))
    }

    #[test]
    fn no_flag_is_cut_off_in_a_terminal_of_80_columns() {
        let mut view = view();
        view.live = Live { saturated: 1, masked: 2, clamped: 4, ..Live::default() };
        let screen = screen(&view);
        for flag in ["saturated", "masked", "> ellipsoid"] {
            assert!(screen.contains(flag), "{flag}");
        }
    }

    #[test]
    fn legend_and_counters_are_not_cut_off_in_a_terminal_of_80_columns() {
        let mut view = view();
        // A session of 100 hours at 100 Hz.
        view.live.t_us = 360_000_000_000;
        view.counters = LinkCounters { frames_received: 36_000_000, frames_lost: 123, ..LinkCounters::default() };
        let screen = screen(&view);
        for text in ["bar: measured, |: model", "q: end", "36000000 received, 123 lost", "messages: 0 damaged"] {
            assert!(screen.contains(text), "{text}");
        }
    }

    #[test]
    fn the_peak_force_of_each_region_is_below_its_label_in_a_terminal_of_80_columns() {
        let mut view = view();
        let mut step = testkit::step(9_999_999);
        step.start_us = 9_999_999_900_000;
        for (region, peak_dn) in step.regions.iter_mut().zip([65_530, 1_230, 40, 3_450, 5_670, 780, 90, 12_340]) {
            region.measured_peak_dn = peak_dn;
        }
        view.step(&step);
        let screen = screen(&view);
        let mut lines = screen.lines().skip_while(|line| !line.contains("A.mid ")).map(str::trim_end);
        let (header, row) = (lines.next().expect("a header"), lines.next().expect("a step"));
        let labels =
            ["step", "start", "stance", "Heel", "P.mid", "A.mid", "Met 1-2", "Met 3-5", "Hallux", "Toe 2", "Toes 3-5"];
        let values = ["9999999", "9999999.9", "0.68", "6553", "123", "4", "345", "567", "78", "9", "1234"];
        let mut end = 0;
        for (label, value) in labels.into_iter().zip(values) {
            let column = end;
            end += header[column..].find(label).expect(label) + label.len();
            assert_eq!(row[column..end].trim_start(), value, "{label}");
        }
        assert_eq!(row.len(), end);
    }

    #[test]
    fn the_list_of_steps_is_bounded_and_uses_the_lines_that_remain() {
        let mut view = view();
        for number in 0..=LISTED {
            view.step(&testkit::step(number as u32));
        }
        assert_eq!(view.steps.len(), LISTED);
        let lines_of_steps = |screen: &str| screen.lines().filter(|line| line.contains(" 5000.0 ")).count();
        let without_alert = screen(&view);
        assert!(without_alert.contains(&format!("steps: {}, newest first", LISTED + 1)));
        assert_eq!(lines_of_steps(&without_alert), 10);
        show_longest_alert(&mut view);
        assert_eq!(lines_of_steps(&screen(&view)), 4);
    }

    #[test]
    fn the_longest_alert_is_not_cut_off_in_a_terminal_of_80_columns() {
        let mut view = view();
        let advice = show_longest_alert(&mut view);
        let screen = screen(&view);
        assert!(shows(&screen, &advice) && screen.contains("q: end"));
    }

    #[test]
    fn neither_an_alert_nor_the_failure_that_ended_a_silence_is_cut_off_in_a_terminal_of_80_columns() {
        let mut view = view();
        let advice = show_longest_alert(&mut view);
        view.step(&testkit::step(4321));
        let failure = "a long failure, ".repeat(MAX_FAULT_TEXT / 16);
        let hello = Hello { fault: Some(testkit::text(&failure)), ..testkit::hello() };
        view.answered_after_silence(&hello, Meanwhile::Restarted);
        let screen = screen(&view);
        for text in ["4321", "q: end", &failure, &advice] {
            assert!(shows(&screen, text), "{text}");
        }
    }

    /// The insole has stored old alerts while no host was connected. Their advice, to unload the foot now, is out of date.
    #[test]
    fn alerts_are_shown_for_five_minutes_and_old_ones_are_not() {
        let advice = client::alert_advice(&longest_alert());
        let minutes = |minutes: u64| Some(Duration::from_secs(60 * minutes));
        for (age, is_shown) in [(None, false), (minutes(10), false), (minutes(1), true)] {
            let mut view = view();
            view.load_record(&LoadRecord::Alert(longest_alert()), age);
            view.wants_to_end().expect("no terminal");
            assert_eq!(shows(&screen(&view), &advice), is_shown, "{age:?}");
        }
        let mut view = view();
        view.load_record(&LoadRecord::Alert(longest_alert()), Some(FRESH));
        view.wants_to_end().expect("no terminal");
        assert!(!shows(&screen(&view), &advice));
    }

    #[test]
    fn ages_of_alerts_are_in_minutes_hours_or_days() {
        let texts = [7, 120, 121, 2880, 2881, 20_000].map(|minutes| age_text(Duration::from_secs(60 * minutes)));
        assert_eq!(texts, ["7 min", "120 min", "2 h", "48 h", "2 days", "13 days"]);
    }

    #[test]
    fn a_matrix_that_does_not_answer_is_named_instead_of_a_restart_until_a_frame_arrives() {
        let mut view = view();
        view.answered_after_silence(&testkit::hello(), Meanwhile::NoFrames);
        let before = screen(&view);
        assert!(shows(&before, NO_FRAMES) && !before.contains("restarted"));
        view.live(&Live::default(), LinkCounters::default()).expect("no terminal");
        assert!(!screen(&view).contains("matrix"));
    }

    #[test]
    fn the_remedy_for_a_lost_link_is_not_cut_off_in_a_terminal_of_80_columns() {
        let mut view = view();
        let advice = show_longest_alert(&mut view);
        let remedy = "which must be closed first; trying again";
        view.notice =
            format!("{} {remedy}", "no answer arrived within 2 s, and the cause is explained in many words".repeat(4));
        let screen = screen(&view);
        for text in [remedy, &advice, "q: end"] {
            assert!(shows(&screen, text), "{text}");
        }
    }
}
