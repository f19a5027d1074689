//! `plantar params`.

use anyhow::Result;
use clap::Subcommand;
use parameters::{InsoleSize, Parameters};
use std::path::PathBuf;

#[derive(Subcommand)]
pub enum Params {
    /// Write typical parameters for a shoe size to a commented file. They are nobody's own.
    Typical {
        /// European shoe size, 35 to 46.
        #[arg(long, default_value_t)]
        size: InsoleSize,
        /// The file to write.
        #[arg(long, value_name = "FILE", default_value = "params.toml")]
        out: PathBuf,
    },
}

impl Params {
    pub fn run(&self) -> Result<()> {
        match self {
            Self::Typical { size, out } => {
                Parameters::typical(*size).write(out)?;
                println!("wrote {}: typical values for size {size}, not personal", out.display());
                Ok(())
            }
        }
    }
}
