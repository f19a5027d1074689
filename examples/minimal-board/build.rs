//! Links the application.

use build_support::{Program, link};

fn main() {
    // The RAM of this board. The flash map is the same for all boards.
    link(Program::Application, 0x2000_0000..0x2002_0000, &[]);
}
