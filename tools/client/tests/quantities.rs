//! `docs/quantities.md` and the JSON of a step have exactly the quantities that the protocol declares.

use client::step_to_json;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::{
    Alert, Bout, BoutRegion, ContactEllipse, Flag, Live, LiveRegion, Quantity, Step, StepFoot, StepRegion,
};
use plantar::{Region, Side};
use std::fmt::Write;

const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/quantities.md");

const INTRODUCTION: &str = "# Quantities

This file is generated from the declarations in `src/protocol/{step,bout,alert,live,ellipses}.rs` by
`UPDATE_DOCS=1 cargo test --release --package client --test quantities`. A test checks that it is up to date.

*Column* is the name in Parquet and CSV files, *key* the one in JSON objects, where `a.b` is the key `b` in the object `a`. Null
is an empty cell in CSV. These columns and keys are no quantities:

- `side` is the foot, `region` the name of a region.
- `kind` of a load bout is `unclassified`, `standing`, `shuffling` or `sitting` ([measures.md](measures.md#load-bouts)).
- `contact_on_kpa`, `contact_off_kpa` and `contact_full_kpa` are the contact rule, in JSON the object `contact_rule`.
- `session`, in files of `plantar record`, is the number of the session with the insole, from 0. Sequence numbers and times can
  start again in each session.
- `unix_s` of a frame and `start_unix_s` of a step, load bout or alert are the times `t_s` and `start_s` in s since 1970: by the
  host's clock or, for a record from before the insole's last start, by that of the insole. They are null if unknown. In Python,
  use `event.unix_s` instead.
- `is_start_comparable`, in files of `plantar record`, is true if `start_unix_s` is exact enough to compare the record with one of
  the other foot ([measures.md](measures.md#both-feet)).

`start_s` is the time since the insole's first scan; in files of `plantar replay` and in Python's `Replay.steps`, it is the time
in the recording.

Four CSV files that the web page for a phone saves have other columns. That of live frames has `unix_s`, `t_s` (time of arrival
since the start of the recording), `device_t_s` (time of the scan on the insole's clock) and one column for each region and each
key of a region, such as `heel_area_mm2`, but no centre of pressure. In those of steps and load bouts, `boots_since` is missing.
In that of steps, `duration_s` is named `contact_time_foot_s`, and `sample_s`, `bridged_frames` and the contact rule are missing.
That of the loads of each day has one row for each foot and local day: the numbers of steps, load bouts and alerts, the sum of the
force-time integrals of steps and load bouts (`force_integral_n_s`), and the largest total force in a step (`foot_force_peak_n`).

In tables an alert has one row for each region, with `sustained` and `dose` of this region. In the JSON object of an alert these
two keys have lists of the names of the regions to which they apply.

A value is an integer on the wire, so it has a resolution and a largest value, which also stands for larger ones;
[hosts.md](hosts.md#absent-quantities) states how null is sent. Quantities of a contact ellipse are null without contact. In a
step, quantities of the model are null without a model force, as on an insole without parameters; the valley and the second peak
of the total force, if there is only one hump; and the centre of pressure excursion index, if the path does not reach two thirds
of the length of the foot. In a live frame, deformation and model force are 0 without parameters. Equations are those of
[model.md](model.md).
";

#[test]
fn the_document_lists_the_declared_quantities() {
    let mut document = String::from(INTRODUCTION);
    // A flag has one bit for each region, so the flags of a step and of a live frame are listed with their regions. An alert has
    // no section of its regions, because its table has one row for each region.
    write_section(&mut document, "A step", Step::QUANTITIES, &[] as &[Flag<Step>]);
    write_section(&mut document, "The foot in a step", StepFoot::QUANTITIES, &[] as &[Flag<Step>]);
    write_section(&mut document, "A region of a step", StepRegion::QUANTITIES, Step::FLAGS);
    write_section(&mut document, "A load bout", Bout::QUANTITIES, &[] as &[Flag<Bout>]);
    write_section(&mut document, "A region of a load bout", BoutRegion::QUANTITIES, &[] as &[Flag<Bout>]);
    write_section(&mut document, "An alert", Alert::QUANTITIES, Alert::FLAGS);
    write_section(&mut document, "A live frame", Live::QUANTITIES, &[] as &[Flag<Live>]);
    write_section(&mut document, "A region of a live frame", LiveRegion::QUANTITIES, Live::FLAGS);
    write_section(
        &mut document,
        "A contact ellipse of the stream of ellipses",
        ContactEllipse::QUANTITIES,
        &[] as &[Flag<ContactEllipse>],
    );
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(DOCUMENT, &document).expect("the folder docs exists");
    }
    let stored = std::fs::read_to_string(DOCUMENT).unwrap_or_default();
    assert!(stored == document, "docs/quantities.md is out of date: run this test with UPDATE_DOCS=1");
}

fn write_section<T, U>(document: &mut String, title: &str, quantities: &[Quantity<T>], flags: &[Flag<U>]) {
    let head =
        "| column | key | unit | resolution | largest | meaning | source | wire |\n|---|---|---|---|---|---|---|---|";
    let quantities = quantities.iter().map(|quantity| {
        let Quantity { field, wire_type, name, key, unit, per_unit, meaning, source, .. } = quantity;
        let resolution = 1.0 / f64::from(*per_unit);
        let largest = largest(wire_type, *per_unit);
        format!(
            "`{name}` | `{key}` | {unit} | {resolution} | {largest} | {meaning} | {source} | `{field}: {wire_type}`"
        )
    });
    let flags = flags.iter().map(|Flag { name, meaning, source, .. }| {
        format!("`{name}` | `{name}` | true or false | | | {meaning} | {source} | one bit of `{name}: u8`")
    });
    let rows: Vec<_> = quantities.chain(flags).map(|row| format!("| {row} |")).collect();
    write!(document, "\n## {title}\n\n{head}\n{}\n", rows.join("\n")).expect("writing to a string succeeds");
}

fn largest(wire_type: &str, per_unit: u32) -> String {
    let largest: u32 = match wire_type {
        "u8" => u8::MAX.into(),
        "i8" => i8::MAX as u32,
        "i16" => i16::MAX as u32,
        "u16" => u16::MAX.into(),
        "u32" => u32::MAX,
        "u64" => return "none".into(),
        _ => panic!("{wire_type} is no integer type of a quantity"),
    };
    (f64::from(largest) / f64::from(per_unit)).to_string()
}

#[test]
fn json_has_every_quantity_once() {
    // With a radius above 0 the region had contact, so its ellipse is not null.
    let region = StepRegion { ellipse_r_a_cmm: 1, ..StepRegion::default() };
    let step = Step {
        step: 0,
        side: Side::Left,
        start_us: 0,
        duration_us: 0,
        sample_us: 0,
        bridged_frames: 0,
        saturated: 0,
        clamped: 0,
        contact_rule: ContactRule::COUNTED,
        regions: [region; 8],
        boots_since: 0,
        start_unix_us: None,
        refit: 0,
        foot: StepFoot::default(),
    };
    let json = step_to_json(&step);
    for quantity in Step::QUANTITIES {
        assert!(json.get(quantity.key).is_some(), "{}", quantity.key);
    }
    for quantity in StepFoot::QUANTITIES {
        let pointer = format!("/foot/{}", quantity.key.replace('.', "/"));
        assert!(json.pointer(&pointer).is_some(), "{}", quantity.key);
    }
    let heel = &json["regions"][Region::Heel.name()];
    for quantity in StepRegion::QUANTITIES {
        let pointer = format!("/{}", quantity.key.replace('.', "/"));
        assert!(heel.pointer(&pointer).is_some(), "{}", quantity.key);
    }
    for flag in Step::FLAGS {
        assert_eq!(heel[flag.name], false);
    }
    let ellipse = heel["ellipse_at_peak"].as_object().expect("the region had contact").len();
    // The key `ellipse_at_peak` itself is no quantity.
    let keys = heel.as_object().expect("an object").len() - 1 + ellipse;
    assert_eq!(keys, StepRegion::QUANTITIES.len() + Step::FLAGS.len());
}
