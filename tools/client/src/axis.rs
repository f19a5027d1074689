//! An insole's clock against the host's, so that several insoles share one axis.

use plantar::protocol::Step;
use std::collections::VecDeque;

/// Of the answers within this time only the quickest question counts.
const WINDOW_US: u64 = 5_000_000;
/// Windows that are remembered: five minutes.
const WINDOWS: usize = 60;
/// Two crystals of 50 ppm differ by no more.
const MAX_DRIFT: f64 = 100e-6;

/// Offset and drift of an insole's clock, from [`plantar::protocol::ToDevice::GetTime`] and its answers.
///
/// A question that is asked at host time `a` finds the insole's clock at `d`: the clock is ahead by `d - a`, less the time on
/// the way. That is never negative, so the line that fits closest below all of `d - a` is the clock (Moon, Skelly and Towsley
/// 1999, "Estimation and removal of clock skew from network delay measurements"). Answers' own time on the way does not
/// matter; the least time of a question does, and is alike for insoles on alike links.
#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// The quickest question of each window, oldest first.
    questions: VecDeque<Question>,
    /// Below all questions, closest at their middle.
    line: Option<Line>,
}

#[derive(Clone, Copy, Debug)]
struct Question {
    device_us: u64,
    ahead_us: i64,
}

/// How far the clock is ahead: `ahead_us` at `device_us`, and more by `drift` a microsecond.
#[derive(Clone, Copy, Debug)]
struct Line {
    device_us: u64,
    ahead_us: i64,
    drift: f64,
}

impl Axis {
    /// Nothing known yet.
    pub const fn new() -> Self {
        Self { questions: VecDeque::new(), line: None }
    }

    /// Takes an answer: asked at `asked_us` of the host's clock, when the insole's showed `device_us`.
    pub fn answer(&mut self, asked_us: u64, device_us: u64) {
        let question = Question { device_us, ahead_us: device_us.wrapping_sub(asked_us) as i64 };
        match self.questions.back_mut() {
            // A clock that goes back is another one: the insole has restarted.
            Some(last) if device_us < last.device_us => self.questions.clear(),
            Some(last) if device_us / WINDOW_US == last.device_us / WINDOW_US => {
                if question.ahead_us < last.ahead_us {
                    *last = question;
                }
                self.line = line_below(&self.questions);
                return;
            }
            _ => {}
        }
        if self.questions.len() == WINDOWS {
            self.questions.pop_front();
        }
        self.questions.push_back(question);
        self.line = line_below(&self.questions);
    }

    /// The host's time, us, when the insole's clock shows `device_us`; `None` before the first answer.
    pub fn host_us(&self, device_us: u64) -> Option<u64> {
        let line = self.line?;
        let since_us = device_us.wrapping_sub(line.device_us) as i64 as f64;
        let ahead_us = line.ahead_us.wrapping_add((line.drift * since_us).round() as i64);
        Some(device_us.wrapping_sub(ahead_us as u64))
    }

    /// When a step began, the host's time, us. Of a step from before the insole's last start only its own clock can tell.
    pub fn step_us(&self, step: &Step) -> Option<u64> {
        if step.boots_since == 0 { self.host_us(step.start_us) } else { step.start_unix_us }
    }

    /// What the insole's clock shows at `host_us`; `None` before the first answer.
    pub fn device_us(&self, host_us: u64) -> Option<u64> {
        let line = self.line?;
        let at_line_us = line.device_us.wrapping_sub(line.ahead_us as u64);
        let since_us = host_us.wrapping_sub(at_line_us) as i64 as f64;
        Some(line.device_us.wrapping_add((since_us / (1.0 - line.drift)).round() as i64 as u64))
    }
}

/// The line below all questions that is closest to them at their mean time: an edge of their lower convex hull.
fn line_below(questions: &VecDeque<Question>) -> Option<Line> {
    let first = questions.front()?;
    let point = |q: &Question| ((q.device_us - first.device_us) as f64, q.ahead_us.wrapping_sub(first.ahead_us) as f64);
    let slope = |a: &Question, b: &Question| (point(b).1 - point(a).1) / (point(b).0 - point(a).0);
    let mut hull: Vec<&Question> = Vec::new();
    for question in questions {
        while let [.., a, b] = hull[..]
            && slope(a, b) >= slope(b, question)
        {
            hull.pop();
        }
        hull.push(question);
    }
    let mean_us = questions.iter().map(|q| point(q).0).sum::<f64>() / questions.len() as f64;
    let edge = hull.windows(2).find(|edge| point(edge[1]).0 >= mean_us);
    let drift = edge.map(|edge| slope(edge[0], edge[1])).filter(|drift| drift.abs() <= MAX_DRIFT);
    let on_line = match (edge, drift) {
        (Some(edge), Some(_)) => edge[0],
        // Too short a time to tell a drift.
        _ => questions.iter().min_by_key(|q| q.ahead_us)?,
    };
    Some(Line { device_us: on_line.device_us, ahead_us: on_line.ahead_us, drift: drift.unwrap_or(0.0) })
}
