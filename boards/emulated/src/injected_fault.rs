//! Injects faults on request, so that tests can observe the recovery. [`inject`] is called in the code of this board, above all
//! in its implementations of the board traits.

use core::cell::Cell;
use core::hint::black_box;
use embassy_sync::blocking_mutex::CriticalSectionMutex;
use embassy_time::Instant;
use embedded_io_async::{ErrorType, Read, Write};
use emulation::{InjectedFault, PlannedFault};

static PLANNED: CriticalSectionMutex<Cell<Option<PlannedFault>>> = CriticalSectionMutex::new(Cell::new(None));

/// Sets the fault to inject.
pub fn plan(planned: Option<PlannedFault>) {
    PLANNED.lock(|place| place.set(planned));
}

/// Injects the planned fault, if its kind is one of `kinds` and it is due.
pub fn inject(kinds: &[InjectedFault]) {
    let planned = PLANNED.lock(Cell::get).filter(|planned| kinds.contains(&planned.kind));
    let Some(planned) = planned.filter(|planned| Instant::now().as_millis() >= planned.after_ms.into()) else { return };
    match planned.kind {
        InjectedFault::ScanStalled | InjectedFault::ProcessStalled | InjectedFault::LinkStalled => loop {
            cortex_m::asm::nop();
        },
        InjectedFault::StackOverflow => {
            black_box(too_deep(planned.after_ms));
        }
        InjectedFault::UndefinedInstruction => cortex_m::asm::udf(),
        InjectedFault::Panic => panic!("planned"),
    }
}

/// Recurses until the stack overflows.
#[inline(never)]
fn too_deep(n: u32) -> u32 {
    let room = black_box([n; 8]);
    if room[1] == u32::MAX { 0 } else { too_deep(room[0] & 0xffff).wrapping_add(room[2]) }
}

/// A port of the link. Its reads and writes stall once a planned [`InjectedFault::LinkStalled`] is due.
pub struct MayStall<R>(pub R);

impl<R: ErrorType> ErrorType for MayStall<R> {
    type Error = R::Error;
}

impl<R: Read> Read for MayStall<R> {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Self::Error> {
        inject(&[InjectedFault::LinkStalled]);
        self.0.read(buffer).await
    }
}

impl<W: Write> Write for MayStall<W> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        inject(&[InjectedFault::LinkStalled]);
        self.0.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), Self::Error> {
        self.0.flush().await
    }
}
