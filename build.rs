//! Links the firmware binaries with `cortex-m-rt`'s script and, where it is used, `defmt`'s.

fn main() {
    println!("cargo:rerun-if-changed=memory.x");
    for (feature, binary) in [("EMU", "plantar_emu"), ("WB55", "plantar_wb55")] {
        if std::env::var_os(format!("CARGO_FEATURE_{feature}")).is_some() {
            println!("cargo:rustc-link-arg-bin={binary}=-Tlink.x");
            println!("cargo:rustc-link-arg-bin={binary}=--nmagic");
        }
    }
    if std::env::var_os("CARGO_FEATURE_WB55").is_some() {
        println!("cargo:rustc-link-arg-bin=plantar_wb55=-Tdefmt.x");
    }
}
