//! `plantar params`: tissue parameters in files and on insoles.

use crate::carrier::{AnyClient, Connection, InsoleLink};
use crate::insole::{restart, settings};
use crate::setup::{note_if_extrapolated, note_unless_personal, note_unless_same_foot, rule_in_words};
use crate::summary;
use anyhow::{Context, Result, bail, ensure};
use clap::Subcommand;
use client::{Error, ReconnectPolicy};
use parameters::{AssumedShare, Identified, InsoleSize, Parameters};
use plantar::Region;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::tissue::{Identified as IdentifiedOnInsole, Tissue};
use plantar::protocol::{Hello, Refusal, Reset, Settings};
use recording::output;
use std::io::Write as _;
use std::path::{Path, PathBuf};

#[derive(Subcommand)]
pub enum Params {
    /// Write typical parameters for a shoe size to a commented file. They are not personal.
    Typical {
        /// European shoe size, a whole number from 20 to 52 [default: 42]. The values for sizes outside of 35 to 46 are
        /// extrapolated.
        #[arg(long)]
        size: Option<InsoleSize>,
        /// The file to write.
        #[arg(long, value_name = "FILE", default_value = "params.toml")]
        out: PathBuf,
    },
    /// Show the parameters in a file or on an insole.
    Show {
        /// The parameter file.
        // In the required group of the connection: either a file or an insole is given.
        #[arg(group = "insole")]
        file: Option<PathBuf>,
        #[command(flatten)]
        connection: Connection,
    },
    /// Send the parameters in a file to an insole, which uses them from its next frame on and stores them. If they were
    /// identified with another contact rule than that of the insole, the insole's rule is changed first, and the insole restarts.
    Push {
        /// The parameter file.
        file: PathBuf,
        #[command(flatten)]
        connection: Connection,
    },
    /// Write the parameters on an insole to a commented file. An insole stores only six values of each region: the product A B,
    /// K, n, G and m, which determine the force, and C, which only scales the deformation.
    Pull {
        /// The file to write.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        #[command(flatten)]
        connection: Connection,
    },
}

impl Params {
    pub fn run(&self) -> Result<()> {
        match self {
            Self::Typical { size, out } => {
                check_not_personal(out)?;
                let parameters = Parameters::typical_for(*size);
                note_if_extrapolated(*size);
                output::file(out, |to| to.write_all(parameters.to_toml().as_bytes()))?;
                println!("wrote {}: {}, not personal", out.display(), parameters.subject);
                Ok(())
            }
            Self::Show { file: Some(file), .. } => {
                show_file(&Parameters::read(file)?);
                Ok(())
            }
            Self::Show { file: None, connection } => {
                let (tissue, identified) = read_tissue(connection)?;
                match identified.as_ref().map(Identified::from_insole) {
                    Some(Identified { filter, contact, side, steps, regions }) => {
                        println!(
                            "identified from {steps} steps ({side}), {filter} filter, {}: {}",
                            rule_in_words(&contact),
                            names(&regions)
                        )
                    }
                    None => println!("not known to be personal"),
                }
                show(&tissue);
                Ok(())
            }
            Self::Push { file, connection } => push(file, connection),
            Self::Pull { out, connection } => pull(out, connection),
        }
    }
}

/// Sends the parameters in a file to an insole, with notes on stderr if they do not fit it.
fn push(file: &Path, connection: &Connection) -> Result<()> {
    let parameters = Parameters::read(file)?;
    note_unless_personal(&parameters);
    let mut insole = connection.open(ReconnectPolicy::RESTART)?;
    let Hello { tissue_id: before, contact_rule, .. } = *insole.client().hello();
    let sent = send(&mut insole, &parameters);
    print_new_rule(&mut insole, contact_rule);
    sent?;
    let id = parameters.tissue().id;
    println!("parameters on the insole: {} before, now {}; they are stored", id_text(before), id_text(id));
    Ok(())
}

/// Sends parameters to an insole. If they were identified with another contact rule than that of the insole, sets the rule first,
/// for which the insole restarts.
pub fn send(insole: &mut InsoleLink, parameters: &Parameters) -> Result<()> {
    let tissue = parameters.tissue();
    let Some(identified) = &parameters.identified else { return Ok(insole.client().set_tissue(&tissue)?) };
    let on_insole = identified.on_insole()?;
    let notes = identified.notes_for_insole(insole.client().hello().side);
    notes.iter().for_each(|note| eprintln!("note: {note}"));
    set_rule(insole, identified.contact)?;
    Ok(insole.client().set_identified_tissue(&tissue, on_insole)?)
}

/// Sets the contact rule of an insole and restarts the insole, unless the rule is in force already.
pub fn set_rule(insole: &mut InsoleLink, contact: ContactRule) -> Result<()> {
    if !settings::are_used(insole.client())? {
        // The restart after an earlier change has failed.
        restart(insole)?;
    }
    let client = insole.client();
    if client.hello().contact_rule == contact {
        return Ok(());
    }
    let settings = Settings { contact, ..settings::stored_or_in_use(client)?.context(settings::NO_LAYOUT)? };
    client.set_settings(Some(settings))?;
    restart(insole)?;
    let in_force = insole.client().hello().contact_rule;
    if in_force != contact {
        bail!(
            "the insole did not adopt the contact rule {}; its rule is still {}: run the command again",
            rule_in_words(&contact),
            rule_in_words(&in_force)
        );
    }
    Ok(())
}

/// Prints the contact rule of an insole if it differs from the rule `before`.
pub fn print_new_rule(insole: &mut InsoleLink, before: ContactRule) {
    let rule = insole.client().hello().contact_rule;
    if rule != before {
        println!("contact rule of the insole: now {}", rule_in_words(&rule));
    }
}

/// Refuses to overwrite a file that contains personal parameters, because neither typical parameters nor those on an insole
/// have all of its information. A file that cannot be read as parameters may contain personal ones, too: it may be damaged, or
/// from a newer program. A device or a pipe, such as /dev/stdout, stores no parameters and is not read.
fn check_not_personal(out: &Path) -> Result<()> {
    if !out.is_file() || out.metadata().is_ok_and(|metadata| metadata.len() == 0) {
        return Ok(());
    }
    let parameters = Parameters::read(out).with_context(|| {
        format!(
            "{} exists and may contain personal parameters, but cannot be read: name another file with --out, or \
             remove this one",
            out.display()
        )
    })?;
    ensure!(
        !parameters.personal,
        "{} contains parameters that were identified from the steps of a person: name another file with --out",
        out.display()
    );
    Ok(())
}

/// Writes the parameters on an insole to a file.
fn pull(out: &Path, connection: &Connection) -> Result<()> {
    check_not_personal(out)?;
    let (tissue, identified) = read_tissue(connection)?;
    let text = format!(
        "# Read from an insole, which stores only A B, C, K, n, G and m. The other values are not known: here\n\
         # a = b = sqrt(A B), d0 = C, k = K / C and c = G / C, which results in the same force.\n\n{}",
        Parameters::from_tissue(&tissue, identified.as_ref()).to_toml()
    );
    output::file(out, |to| to.write_all(text.as_bytes()))?;
    println!("wrote {}: parameters {}", out.display(), id_text(tissue.id));
    Ok(())
}

/// Reads the parameters on an insole, and how they were identified.
fn read_tissue(connection: &Connection) -> Result<(Tissue, Option<IdentifiedOnInsole>)> {
    let mut insole = connection.open(ReconnectPolicy::RESTART)?;
    let tissue = insole.client().tissue()?;
    if tissue == Tissue::NONE {
        // After a crash, the fault describes the crash.
        let hello = insole.client().hello();
        let has_crashed = matches!(hello.reset, Reset::Panic | Reset::Watchdog);
        let fault = hello.fault.as_ref().filter(|_| !has_crashed);
        let reason = fault.map_or(String::new(), |fault| format!(" ({fault})"));
        bail!("the insole uses no parameters{reason}: send some with `plantar params push`");
    }
    let identified = match insole.client().identified() {
        // Older firmware does not store how its parameters were identified, and does not know the request.
        Err(Error::Refused(Refusal::NotUnderstood)) => None,
        identified => identified?,
    };
    Ok((tissue, identified))
}

/// Prints a note on stderr if the parameters on an insole were identified from the other foot.
pub fn note_unless_of_this_foot(insole: &mut InsoleLink) {
    let client = insole.client();
    // Older firmware does not know the request.
    let identified = client.identified().ok().flatten().map(|identified| Identified::from_insole(&identified));
    note_unless_same_foot(identified.as_ref(), client.hello().side);
}

/// Prints a note on stderr if an insole evaluates regions with typical parameters.
pub fn note_unless_identified(client: &mut AnyClient) {
    if client.hello().tissue_id == 0 {
        return;
    }
    // The note is not worth an end of the session.
    let Ok(identified) = client.identified() else { return };
    let typical: Vec<Region> = IdentifiedOnInsole::typical_regions(identified).collect();
    if !typical.is_empty() {
        eprintln!(
            "note: the insole computes model force and deformation with parameters that are not known to be the wearer's ({}): \
             identify them with `plantar identify`",
            names(&typical)
        );
    }
}

/// The identifier of a parameter set as text. Sets with the same identifier are equal.
fn id_text(id: u32) -> String {
    if id == 0 { "none".into() } else { format!("{id:08x}") }
}

/// Prints the eight parameters of each region of a file, and the values that an insole derives from them.
fn show_file(parameters: &Parameters) {
    let kind = if parameters.personal { "personal" } else { "not personal" };
    println!("{}, {kind}", parameters.subject);
    let regions = Region::ALL.iter().zip(&parameters.regions).map(|(region, e)| {
        let mut row = vec![region.name().to_string()];
        row.extend([e.a_m, e.b_m, e.c_m, e.d0_m].map(|m| format!("{:.2}", m * 1e3)));
        row.extend([format!("{:.4e}", e.k), format!("{:.2}", e.n), format!("{:.4e}", e.c), format!("{:.2}", e.m)]);
        row
    });
    print_table(["region", "A mm", "B mm", "C mm", "d0 mm", "k N/m3", "n", "c N s/m3", "m"], regions);
    println!("Share of assumption in C, the scale of the deformation: {}.", AssumedShare(&parameters.deformation));
    if let Some(Identified { regions, .. }) = &parameters.identified {
        println!("Identified from steps: {}.", names(regions));
    }
    show(&parameters.tissue());
}

/// The names of regions, or that they are all, or not known, as after an update of older firmware.
fn names(regions: &[Region]) -> String {
    match regions.len() {
        0 => "regions not known".into(),
        8 => "all regions".into(),
        _ => regions.iter().map(|region| region.name()).collect::<Vec<_>>().join(", "),
    }
}

/// Prints the parameters in the form that an insole uses.
fn show(tissue: &Tissue) {
    println!("Parameters {} as an insole uses them:", id_text(tissue.id));
    let regions = Region::ALL.iter().zip(&tissue.force_laws).map(|(region, law)| {
        vec![
            region.name().to_string(),
            format!("{:.1}", law.stiffness_pa * 1e-3),
            format!("{:.2}", law.n),
            format!("{:.3}", law.damping_pa_s * 1e-3),
            format!("{:.2}", law.m),
            format!("{:.1}", law.ab_m2 * 1e6),
            format!("{:.2}", law.c_m * 1e3),
        ]
    });
    print_table(["region", "K kPa", "n", "G kPa s", "m", "A B mm2", "C mm"], regions);
}

/// Prints a table.
fn print_table<const N: usize>(header: [&str; N], rows: impl Iterator<Item = Vec<String>>) {
    let mut table = summary::table();
    table.set_header(header).add_rows(rows);
    summary::align(&mut table);
    println!("{table}");
}
