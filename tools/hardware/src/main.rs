//! scratch
fn main() -> anyhow::Result<()> {
    let results = hardware::figures::simulate(&hardware::netlist::Netlist::reference())?;
    for figure in &results.figures {
        println!("{:<38} {:>12.4}  {:<18} {}", figure.key, figure.value, figure.bar_text(), figure.meaning);
    }
    for s in &results.settling { println!("{} {:.2}", s.name, s.settled_s*1e6); }
    for s in &results.loops { println!("{} {:.1}", s.name, s.phase_margin_deg); }
    for s in &results.noise { println!("{} {:.2}", s.name, s.code_rms); }
    for (r,c) in &results.transfer { println!("{r} {c:.1}"); }
    for (r,c) in &results.row_error { println!("{r} {c:.3}"); }
    Ok(())
}
