use emulator::Electrical;
use plantar::Side;
use plantar::contact::ContactRule;
use plantar::insole::{DEVICE_CELLS, Insole};
use plantar::stance::StanceRule;
use recording::{Recording, VirtualInsole, jiku, pedar, synthetic};

fn walks() -> Vec<(String, Recording)> {
    let mut w = vec![];
    for hz in [50.0, 100.0, 400.0] {
        w.push((
            format!("syn{hz}"),
            synthetic::walk(&synthetic::SyntheticWalk { steps: 12, rate_hz: hz, ..Default::default() }).recording,
        ));
    }
    if let Some(d) = std::env::var_os("PLANTAR_JIKU") {
        for s in 0..10 {
            let j = jiku::import(&d, s, 0..60, &mut |_, _| ()).unwrap();
            for hz in [50.0, 100.0] {
                w.push((format!("jiku{s} {hz}"), j.at_rate(hz).unwrap().binned(DEVICE_CELLS).unwrap()));
            }
        }
    }
    let data = std::path::PathBuf::from("/work/shared/data/pedar");
    for side in [Side::Left, Side::Right] {
        w.push((
            format!("pedar {side:?}"),
            pedar::import(data.join("pedar_example.asc"), data.join("geometry.csv"), side, &mut |_, _| ()).unwrap(),
        ));
    }
    w
}

#[test]
fn clean() {
    for (name, rec) in walks() {
        for rule in [ContactRule::COUNTED, ContactRule::COVERED] {
            let worn = VirtualInsole::new(&rec, rule, StanceRule::WALKING);
            let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
            insole.set_up(worn.setup, worn.cells.iter().copied()).unwrap();
            let mut codes = vec![0; worn.cells.len()];
            let mut steps = 0;
            for i in 0..worn.frames(&rec) {
                worn.codes_of(&rec, i, &mut codes);
                steps += u32::from(insole.frame(i as u32, &codes));
            }
            println!(
                "{name} {} cells {steps} steps: found {} rezeroed {} reviews {:?} {:?}",
                worn.cells.len(),
                insole.faults().found,
                insole.faults().rezeroed,
                (),
                insole.faults().list
            );
        }
    }
}

#[test]
fn inject() {
    use plantar::fault::{FaultKind as K, Place as P};
    let mut rng = fastrand::Rng::with_seed(5);
    for (name, rec) in
        walks().into_iter().filter(|(n, _)| n.starts_with("syn") || n == "jiku2 100" || n.starts_with("pedar"))
    {
        let worn = VirtualInsole::new(&rec, ContactRule::COUNTED, StanceRule::WALKING);
        let n = worn.cells.len();
        let run = |faults: &[Electrical]| {
            let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
            insole.set_up(worn.setup, worn.cells.iter().copied()).unwrap();
            let mut codes = vec![0; n];
            let zeros = vec![0; n];
            let mut toeoffs = vec![];
            for i in 0..worn.frames(&rec) {
                worn.codes_of(&rec, i, &mut codes);
                let t = i as f64 * worn.setup.period_us as f64 / 1e6;
                for f in faults {
                    f.apply(t, &zeros, &mut codes);
                }
                if insole.frame(i as u32, &codes) {
                    toeoffs.push(t)
                }
            }
            (insole.faults().list.to_vec(), insole.faults().rezeroed, toeoffs)
        };
        let mut peak = vec![0u16; n];
        let mut codes = vec![0; n];
        for i in 0..worn.frames(&rec) {
            worn.codes_of(&rec, i, &mut codes);
            for (p, &c) in peak.iter_mut().zip(&codes) {
                *p = (*p).max(c)
            }
        }
        let (_, _, offs) = run(&[]);
        let from = offs[4] - 0.3;
        for kind in 0..10 {
            let (mut ok, mut tot, mut worst) = (0, 0, 0.0f64);
            let mut missed = vec![];
            for _ in 0..20 {
                let c = loop {
                    let c = rng.usize(0..n);
                    if peak[c] > 8192 {
                        break c;
                    }
                };
                let row = rng.u8(0..(n.div_ceil(16)) as u8);
                let col = rng.u8(0..16);
                let (kind, place, value) = match kind {
                    0 => (K::Open, P::Cell(c as u16), 0.0),
                    1 => (K::Short, P::Cell(c as u16), 0.0),
                    2 => (K::Stuck, P::Cell(c as u16), 12000.0),
                    3 => (K::Saturated, P::Cell(c as u16), 0.0),
                    4 => (K::Drift, P::Cell(c as u16), 50.0),
                    5 => (K::Open, P::Row(row), 0.0),
                    6 => (K::Short, P::Row(row), 0.0),
                    7 => (K::Open, P::Column(col), 0.0),
                    8 => (K::Short, P::Column(col), 0.0),
                    _ => (K::Crosstalk, P::Row(row), 0.1),
                };
                let f = Electrical { kind, place, value, from_s: from };
                let (found, rezeroed, _) = run(&[f]);
                tot += 1;
                let hit = found.iter().find(|x| x.place == place);
                if let Some(h) = hit {
                    ok += 1;
                    let _ = h.kind;
                    worst = worst.max(h.found_ms as f64 / 1e3 - from);
                    if h.kind != kind || found.len() > 1 && !name.starts_with("jiku") {
                        println!("  {f} told as {found:?}")
                    }
                } else if kind == K::Drift && rezeroed > 0 {
                    ok += 1
                } else {
                    missed.push((place, peak[c], found.clone()))
                }
            }
            println!("{name} kind {kind}: {ok}/{tot} worst {worst:.2} s; missed {:?}", &missed[..missed.len().min(4)]);
        }
    }
}
