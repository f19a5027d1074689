//! What goes wrong on purpose, so that tests see the board recover. The code that it happens to is the board's side of the traits.

use core::cell::Cell;
use core::hint::black_box;
use embassy_sync::blocking_mutex::CriticalSectionMutex;
use embassy_time::Instant;
use embedded_io_async::{ErrorType, Read};
use plantar::emulation::{Mishap, Planned};

static PLANNED: CriticalSectionMutex<Cell<Option<Planned>>> = CriticalSectionMutex::new(Cell::new(None));

/// From its time on it may happen.
pub fn plan(planned: Option<Planned>) {
    PLANNED.lock(|place| place.set(planned));
}

/// One of these happens here if it is planned and due.
pub fn may_happen(here: &[Mishap]) {
    let planned = PLANNED.lock(Cell::get).filter(|planned| here.contains(&planned.what));
    let Some(planned) = planned.filter(|planned| Instant::now().as_millis() >= planned.after_ms.into()) else { return };
    match planned.what {
        Mishap::ScanWedged | Mishap::ModelWedged | Mishap::LinkWedged => loop {
            cortex_m::asm::nop();
        },
        Mishap::StackOverflow => {
            black_box(too_deep(planned.after_ms));
        }
        Mishap::Fault => cortex_m::asm::udf(),
        Mishap::Panic => panic!("planned"),
    }
}

/// Deeper than any stack.
#[inline(never)]
fn too_deep(n: u32) -> u32 {
    let room = black_box([n; 8]);
    if room[1] == u32::MAX { 0 } else { too_deep(room[0] & 0xffff).wrapping_add(room[2]) }
}

/// What the link reads from.
pub struct MayWedge<R>(pub R);

impl<R: ErrorType> ErrorType for MayWedge<R> {
    type Error = R::Error;
}

impl<R: Read> Read for MayWedge<R> {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Self::Error> {
        may_happen(&[Mishap::LinkWedged]);
        self.0.read(buffer).await
    }
}
