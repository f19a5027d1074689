//! Steps from the messages of an insole: they agree with those of a recording of all cells, and incomplete steps are excluded.

use fit::live::{INTERPOLATED_FRAMES, LiveSteps};
use fit::steps::ExclusionReason;
use fit::{Options, Study};
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{Bout, Live, MAX_MESSAGE, Step, ToHost, decode, encode};
use plantar::{Region, Side};
use recording::synthetic::{SyntheticWalk, walk};
use recording::{Recording, VirtualInsole};

const CONTACT: ContactRule = ContactRule::COVERED;

fn computed_walk(steps: usize) -> Recording {
    walk(&SyntheticWalk { steps, variation: 0.1, ..SyntheticWalk::default() }).recording
}

/// The live frames, step records and load bouts of an insole during the recording, after they were encoded and decoded.
fn messages(recording: &Recording) -> Vec<ToHost> {
    let computed = VirtualInsole::new(recording, CONTACT, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f32, 256>::new());
    insole.set_up(computed.setup, computed.cells.iter().copied()).expect("a valid insole");
    let mut codes = vec![0; computed.cells.len()];
    let mut messages = Vec::new();
    for frame in 0..computed.frames(recording) {
        computed.codes_of(recording, frame, &mut codes);
        let is_toe_off = insole.frame(frame as u32, &codes);
        let t_us = frame as u64 * u64::from(computed.setup.period_us);
        messages.push(ToHost::Live(Live::new(
            frame as u32,
            t_us,
            insole.loads(),
            insole.masked(),
            insole.foot_centre_mm(),
        )));
        if is_toe_off && let Some(step) = insole.whole_step() {
            messages.push(ToHost::Step(Step::new(&step)));
        }
        // Steps and load bouts are numbered together: taking a bout advances the number of the next step.
        messages.extend(insole.take_bout().map(|bout| ToHost::Bout(Bout::new(&bout))));
    }
    let over_the_wire = |message: &ToHost| {
        let mut buffer = [0; MAX_MESSAGE];
        decode(encode(message, &mut buffer).expect("a message")).expect("the same message")
    };
    messages.iter().map(over_the_wire).collect()
}

fn collect<'m>(messages: impl IntoIterator<Item = &'m ToHost>) -> LiveSteps {
    let mut live = LiveSteps::new();
    collect_into(&mut live, messages);
    live
}

fn collect_into<'m>(live: &mut LiveSteps, messages: impl IntoIterator<Item = &'m ToHost>) {
    for message in messages {
        match message {
            ToHost::Live(frame) => live.frame(frame),
            ToHost::Step(step) => live.step(step),
            _ => (),
        }
    }
    live.finish();
}

/// Adds the steps among `messages` again as the steps of a later boot, of which the numbers are greater by 5.
fn add_renumbered(live: &mut LiveSteps, messages: &[ToHost]) {
    for message in messages {
        if let ToHost::Step(step) = message {
            live.step(&Step { step: step.step + 5, ..*step });
        }
    }
}

/// Collects `messages`, except the live frames that are lost: `is_lost` returns true for their time, us.
fn without(messages: &[ToHost], is_lost: impl Fn(u64) -> bool) -> LiveSteps {
    collect(messages.iter().filter(|message| !matches!(message, ToHost::Live(live) if is_lost(live.t_us))))
}

fn reasons(live: &LiveSteps) -> Vec<ExclusionReason> {
    live.collected(0).1.iter().map(|contact| contact.reason).collect()
}

#[test]
fn a_live_stream_and_the_recording_of_all_cells_result_in_the_same_parameters() {
    let recording = computed_walk(30);
    let options = Options::usual([0.012; 8]);
    let mut of_cells = Study::new("cells".into(), CONTACT, options);
    let insole = VirtualInsole::new(&recording, CONTACT, StanceRule::ADAPTIVE);
    of_cells.add("a walk".into(), &recording, &insole, &mut |_| ()).expect("a valid insole");
    let mut of_messages = Study::new("messages".into(), CONTACT, options);
    let live = collect(&messages(&recording));
    of_messages.add_live("a walk".into(), String::new(), Side::Right, &live).expect("one contact rule");
    assert_eq!(of_messages.sources[0].rate_hz, 100.0);

    assert_eq!(of_messages.steps.len(), of_cells.steps.len());
    for (ours, theirs) in of_messages.steps.iter().zip(&of_cells.steps) {
        assert_eq!((ours.number, ours.duration_s), (theirs.number, theirs.duration_s));
        assert!((ours.peak_n / theirs.peak_n - 1.0).abs() < 1e-3);
        for (ours, theirs) in ours.regions.iter().zip(&theirs.regions) {
            let differ = |a: &[f64], b: &[f64], most: f64| a.iter().zip(b).any(|(a, b)| (a - b).abs() > most);
            assert_eq!(ours.area_mm2.len(), theirs.area_mm2.len());
            assert!(!differ(&ours.area_mm2, &theirs.area_mm2, 0.51) && !differ(&ours.force_n, &theirs.force_n, 0.06));
            assert!(!differ(&ours.frame_area_mm2, &theirs.frame_area_mm2, 0.51));
        }
    }
    of_cells.fit(&|_| ());
    of_messages.fit(&|_| ());
    for (region, (ours, theirs)) in Region::ALL.iter().zip(of_messages.fits.iter().zip(&of_cells.fits)) {
        let (ours, theirs) = (ours.as_ref().expect("fitted"), theirs.as_ref().expect("fitted"));
        let predicted = |fit: &fit::RegionFit| fit.quality.predicted.expect("several steps");
        let ratio = predicted(ours) / predicted(theirs);
        assert!((0.95..1.05).contains(&ratio), "{}: {ratio}", region.name());
        let intervals = |fit: &fit::RegionFit| fit.uncertainty.clone().expect("intervals").intervals;
        for (ours, theirs) in intervals(ours).iter().zip(&intervals(theirs)) {
            // The upper bound of A B is a multiple of the largest area, which is rounded in a live stream. Intervals that end
            // at this bound differ by the rounding, and whether such a parameter is determined may, too.
            assert!(ours.at_bound && theirs.at_bound || ours.is_identifiable == theirs.is_identifiable);
            let contains = |[low, high]: [f64; 2], value: f64| low <= value && value <= high;
            let is_equal = (ours.value - theirs.value).abs() <= 1e-3 * theirs.value.abs();
            let agree = is_equal || (contains(ours.jacobian, theirs.value) && contains(theirs.jacobian, ours.value));
            assert!(agree || !ours.is_identifiable, "{}: {ours:?} for {theirs:?}", region.name());
        }
    }
}

/// The frame of a walk with the largest load, repeated for four seconds: the wearer stands.
fn standing(walk: &Recording) -> Vec<f32> {
    let load = |frame: usize| walk.frame(frame).iter().sum::<f32>();
    let standing = (0..walk.frames()).max_by(|&a, &b| load(a).total_cmp(&load(b))).expect("there are frames");
    walk.frame(standing).repeat(400)
}

/// A recording with the insole and the frame rate of the walk, and these pressures.
fn with_pressures(walk: &Recording, pressure_kpa: Vec<f32>) -> Recording {
    let t_s = (0..pressure_kpa.len() / walk.cells()).map(|frame| frame as f64 / walk.rate_hz).collect();
    Recording { t_s, pressure_kpa, ..walk.clone() }
}

/// The walk of a wearer who stood for four seconds before, and lifted the foot for three seconds before and after standing.
fn after_standing(walk: &Recording) -> Recording {
    let lifted = vec![0.0; 300 * walk.cells()];
    with_pressures(walk, [&*lifted, &standing(walk), &lifted, &walk.pressure_kpa].concat())
}

/// Steps and load bouts are numbered together.
#[test]
fn steps_after_a_load_bout_have_the_numbers_that_an_insole_sends() {
    let recording = after_standing(&computed_walk(4));
    let sent = messages(&recording);
    let sent: Vec<u32> = sent
        .iter()
        .filter_map(|message| if let ToHost::Step(step) = message { Some(step.step) } else { None })
        .collect();
    assert_eq!((sent.len(), sent.last()), (4, Some(&4)), "one of the numbers is that of the load bout");
    let insole = VirtualInsole::new(&recording, CONTACT, StanceRule::ADAPTIVE);
    let (steps, _) = fit::steps::isolate(&insole, insole.scans(&recording), 0, &mut |_| ()).expect("a valid insole");
    assert_eq!(steps.iter().map(|step| step.number).collect::<Vec<_>>(), sent);
}

/// The contact has two defects: it is longer than a step, and its toe off is missing.
#[test]
fn standing_until_the_end_of_a_recording_is_excluded_once() {
    let walk = computed_walk(4);
    let recording = with_pressures(&walk, [&*walk.pressure_kpa, &standing(&walk)].concat());
    let insole = VirtualInsole::new(&recording, CONTACT, StanceRule::ADAPTIVE);
    let isolated = fit::steps::isolate(&insole, insole.scans(&recording), 0, &mut |_| ());
    let (steps, excluded) = isolated.expect("a valid insole");
    let reasons: Vec<_> = excluded.iter().map(|contact| contact.reason).collect();
    assert_eq!((steps.len(), reasons), (4, vec![ExclusionReason::Long]));
}

#[test]
fn steps_of_a_recording_begin_at_the_times_of_its_frames() {
    // The insole rounds the period of 1/300 s to 3333 us, which is a whole frame less after 33 s.
    let recording = walk(&SyntheticWalk { steps: 40, rate_hz: 300.0, ..SyntheticWalk::default() }).recording;
    let insole = VirtualInsole::new(&recording, CONTACT, StanceRule::ADAPTIVE);
    let (steps, _) = fit::steps::isolate(&insole, insole.scans(&recording), 0, &mut |_| ()).expect("a valid insole");
    assert!(steps.len() == 40 && steps[39].start_s > 33.0);
    assert!(steps.iter().all(|step| recording.t_s.contains(&step.start_s)));
}

#[test]
fn up_to_three_missing_frames_are_interpolated_and_more_exclude_the_step() {
    let messages = messages(&computed_walk(5));
    let whole = collect(&messages).collected(0).0;
    let start_us = (whole[2].start_s * 1e6).round() as u64;
    let lose =
        |first_us: u64, frames: u64| without(&messages, |t_us| t_us >= first_us && t_us < first_us + frames * 10_000);
    // The missing frames are in the middle of the stance, at its heel strike, or just before its toe off.
    let last_us = start_us + (whole[2].duration_s * 1e6).round() as u64 - INTERPOLATED_FRAMES * 10_000;
    for first_us in [start_us + 200_000, start_us, last_us] {
        let bridged = lose(first_us, INTERPOLATED_FRAMES).collected(0).0;
        assert_eq!(bridged.len(), 5);
        for (bridged, whole) in bridged[2].regions.iter().zip(&whole[2].regions) {
            assert_eq!(bridged.area_mm2.len(), whole.area_mm2.len());
            let most = whole.force_n.iter().copied().fold(0.0, f64::max);
            let differ = bridged.force_n.iter().zip(&whole.force_n).any(|(a, b)| (a - b).abs() > 0.2 * most);
            assert!(!differ, "{:?} for {:?}", bridged.force_n, whole.force_n);
        }
        let broken = lose(first_us, INTERPOLATED_FRAMES + 1);
        assert_eq!(broken.collected(0).0.len(), 4);
        assert_eq!(reasons(&broken), [ExclusionReason::Broken]);
    }
}

#[test]
fn repeated_messages_count_once_and_steps_without_their_frames_are_excluded() {
    let messages = messages(&computed_walk(5));
    let count = |live: &LiveSteps| live.collected(0).0.len();
    assert_eq!(count(&collect(messages.iter().flat_map(|message| [message, message]))), 5);
    assert_eq!(count(&collect(messages.iter().chain(&messages))), 5);

    let is_step = |message: &&ToHost| matches!(message, ToHost::Step(_));
    assert_eq!(reasons(&collect(messages.iter().filter(is_step))), [ExclusionReason::BeforeStream; 5]);
    // The stream begins in the second step.
    let first_us = match messages.iter().filter(is_step).nth(1) {
        Some(ToHost::Step(step)) => step.start_us + 100_000,
        _ => unreachable!("a second step"),
    };
    let late = without(&messages, |t_us| t_us < first_us);
    assert_eq!((count(&late), reasons(&late)), (3, vec![ExclusionReason::BeforeStream; 2]));

    let after_restart = messages.iter().map(|message| match message {
        ToHost::Step(step) => ToHost::Step(Step { boots_since: 1, ..*step }),
        live => live.clone(),
    });
    let after_restart: Vec<_> = after_restart.collect();
    assert_eq!(reasons(&collect(&after_restart)), [ExclusionReason::BeforeRestart; 5]);
    // Steps that were received before the restart and are sent again count once.
    assert_eq!(count(&collect(messages.iter().chain(&after_restart))), 5);
}

#[test]
fn an_insole_may_restart_with_a_lower_frame_rate() {
    let at = |rate_hz, seed| {
        messages(&walk(&SyntheticWalk { steps: 5, rate_hz, variation: 0.1, seed, ..Default::default() }).recording)
    };
    let (fast, slow) = (at(200.0, 1), at(50.0, 2));
    let live = collect(fast.iter().chain(&slow));
    assert_eq!((live.collected(0).0.len(), reasons(&live)), (10, vec![]));
    assert!((live.rate_hz() - 50.0).abs() < 1e-9, "{}", live.rate_hz());
}

/// After a restart, the records that are stored on the insole arrive before its first live frame. Their times equal those of
/// other steps, from before the restart.
#[test]
fn a_step_after_a_restart_is_not_combined_with_frames_before_the_restart() {
    let messages = messages(&computed_walk(5));
    let mut live = collect(&messages);
    live.session_started();
    add_renumbered(&mut live, &messages);
    live.finish();
    assert_eq!((live.collected(0).0.len(), reasons(&live)), (5, vec![ExclusionReason::BeforeStream; 5]));
}

/// The insole has run longer after the restart than before it, so the times of the frames do not show the restart.
#[test]
fn a_restart_that_only_the_times_of_steps_show_is_recognised() {
    const LATER_US: u64 = 60_000_000;
    let messages = messages(&computed_walk(5));
    let mut live = collect(&messages);
    live.session_started();
    add_renumbered(&mut live, &messages);
    for message in &messages {
        match message {
            ToHost::Live(frame) => live.frame(&Live { t_us: frame.t_us + LATER_US, ..*frame }),
            ToHost::Step(step) => {
                live.step(&Step { step: step.step + 10, start_us: step.start_us + LATER_US, ..*step })
            }
            _ => (),
        }
    }
    live.finish();
    assert_eq!((live.collected(0).0.len(), reasons(&live)), (10, vec![ExclusionReason::BeforeStream; 5]));
}

/// Neither the frames nor the numbers show the restart, but the frames of the former boot have other forces.
#[test]
fn a_step_is_not_combined_with_frames_of_other_forces() {
    let messages = messages(&computed_walk(5));
    let mut live = LiveSteps::new();
    for message in &messages {
        match message {
            ToHost::Live(frame) => {
                let mut frame = *frame;
                frame.regions[Region::Heel as usize].measured_dn /= 2;
                live.frame(&frame);
            }
            ToHost::Step(step) => live.step(step),
            _ => (),
        }
    }
    live.finish();
    assert_eq!((live.collected(0).0.len(), reasons(&live)), (0, vec![ExclusionReason::Broken; 5]));
}

/// Under a high arch, cells carry less than the contact threshold: the frames have their force, but the record has no contact.
#[test]
fn a_step_with_regions_below_the_contact_threshold_is_used() {
    let mut recording = computed_walk(3);
    let midfoot = [Region::PosteriorMidfoot, Region::AnteriorMidfoot];
    let cells: Vec<bool> = recording.layout.cells.iter().map(|cell| midfoot.contains(&cell.region)).collect();
    for (kpa, is_midfoot) in recording.pressure_kpa.iter_mut().zip(cells.iter().cycle()) {
        *kpa = if *is_midfoot { kpa.min(4.0) } else { *kpa };
    }
    let messages = messages(&recording);
    let has_force = |message: &ToHost| match message {
        ToHost::Live(frame) => frame.regions[Region::AnteriorMidfoot as usize].measured_dn > 20,
        _ => false,
    };
    assert!(messages.iter().any(has_force));
    let live = collect(&messages);
    assert_eq!((live.collected(0).0.len(), reasons(&live)), (3, vec![]));
}

/// The link was lost without a restart, and a record arrives only in the next session.
#[test]
fn a_step_whose_record_arrives_in_the_next_session_is_used() {
    let mut messages = messages(&computed_walk(5));
    let record = messages.iter().position(|message| matches!(message, ToHost::Step(_))).expect("a step");
    let mut live = collect(&messages[..record]);
    live.session_started();
    // The record arrives before the next frame.
    collect_into(&mut live, messages.drain(record..).collect::<Vec<_>>().iter());
    assert_eq!((live.collected(0).0.len(), reasons(&live)), (5, vec![]));
}

#[test]
fn a_record_may_arrive_before_the_last_frames_of_its_stance() {
    let mut messages = messages(&computed_walk(3));
    for i in 0..messages.len() {
        if matches!(messages[i], ToHost::Step(_)) {
            messages[i - 8..=i].rotate_right(1);
        }
    }
    assert_eq!(collect(&messages).collected(0).0.len(), 3);
}

#[test]
fn a_long_stance_is_decimated_as_on_the_insole() {
    let recording =
        walk(&SyntheticWalk { steps: 3, stance_s: 2.4, rate_hz: 200.0, ..SyntheticWalk::default() }).recording;
    let insole = VirtualInsole::new(&recording, CONTACT, StanceRule::ADAPTIVE);
    let (of_cells, _) = fit::steps::isolate(&insole, insole.scans(&recording), 0, &mut |_| ()).expect("a valid insole");
    let (of_messages, _) = collect(&messages(&recording)).collected(0);
    assert_eq!((of_messages.len(), of_cells.len()), (3, 3));
    for (ours, theirs) in of_messages.iter().zip(&of_cells) {
        let (ours, theirs) = (&ours.regions[0], &theirs.regions[0]);
        assert!(ours.sample_s > 1.5 * ours.frame_s);
        assert_eq!((ours.area_mm2.len(), ours.sample_s), (theirs.area_mm2.len(), theirs.sample_s));
        assert!(ours.area_mm2.iter().zip(&theirs.area_mm2).all(|(a, b)| (a - b).abs() <= 0.51));
    }
}

#[test]
fn partial_steps_are_excluded_and_contact_rules_are_not_mixed() {
    let mut messages = messages(&computed_walk(6));
    let (from_us, to_us) = match messages.iter().find(|message| matches!(message, ToHost::Step(_))) {
        Some(ToHost::Step(step)) => (step.start_us, step.start_us + u64::from(step.duration_us)),
        _ => unreachable!("a step"),
    };
    for message in &mut messages {
        if let ToHost::Live(live) = message
            && (from_us..to_us).contains(&live.t_us)
        {
            live.regions.iter_mut().for_each(|region| region.measured_dn /= 2);
        } else if let ToHost::Step(step) = message
            && step.start_us == from_us
        {
            step.regions.iter_mut().for_each(|region| region.measured_peak_dn /= 2);
        }
    }
    let live = collect(&messages);
    assert_eq!(live.collected(0).0.len(), 5);
    assert!(matches!(reasons(&live)[..], [ExclusionReason::Partial(share)] if (share - 0.5).abs() < 0.1));

    if let Some(ToHost::Step(step)) = messages.iter_mut().rfind(|message| matches!(message, ToHost::Step(_))) {
        step.contact_rule = ContactRule::COUNTED;
    }
    let mut study = Study::new("mixed".into(), CONTACT, Options::usual([0.012; 8]));
    let mixed = study.add_live("a walk".into(), String::new(), Side::Right, &collect(&messages));
    assert_eq!(mixed.map_err(|error| error.found), Err(ContactRule::COUNTED));
    assert!(study.sources.is_empty());
}

/// The recording, in which each cell has the load of the cell that is nearest to its mirror image, as if the insole lay under
/// the other foot.
fn mirrored(recording: &Recording) -> Recording {
    let cells = &recording.layout.cells;
    let extreme_mm =
        |pick: fn(f64, f64) -> f64, start: f64| cells.iter().fold(start, |extreme, cell| pick(extreme, cell.x_mm));
    let sum_mm = extreme_mm(f64::min, f64::INFINITY) + extreme_mm(f64::max, f64::NEG_INFINITY);
    let image = |i: usize| {
        let distance = |j: &usize| (cells[*j].x_mm - (sum_mm - cells[i].x_mm)).hypot(cells[*j].y_mm - cells[i].y_mm);
        (0..cells.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("there are cells")
    };
    let images: Vec<usize> = (0..cells.len()).map(image).collect();
    let frames = (0..recording.frames()).flat_map(|frame| images.iter().map(move |&cell| recording.frame(frame)[cell]));
    Recording { pressure_kpa: frames.collect(), ..recording.clone() }
}

#[test]
fn an_insole_under_the_other_foot_is_noticed_after_five_steps() {
    let walk = computed_walk(6);
    assert!(!collect(&messages(&walk)).looks_mirrored());
    let other = messages(&mirrored(&walk));
    assert!(collect(&other).looks_mirrored());
    let first = other.iter().position(|message| matches!(message, ToHost::Step(step) if step.step == 4));
    assert!(!collect(&other[..first.expect("a fifth step")]).looks_mirrored());
}
