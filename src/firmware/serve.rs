//! The insole's side of a session over a byte carrier, such as a serial port.

use super::manage::IS_MANAGED;
use super::shared::{Carrier, Shared};
use super::supervise::Part;
use crate::protocol::{Decoder, MAX_FRAME, MAX_MESSAGE, decode, frame};
use core::pin::pin;
use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer};
use embedded_io_async::{Read, Write};
use mcumgr::line::{self, END};

/// Largest number of bytes in one read of the carrier.
pub const READ_BYTES: usize = 64;

/// Longest time between two heartbeats of an idle link.
const IDLE: Duration = Duration::from_millis(200);

/// Longest part of a frame that is written at once, bytes. Some drivers, such as `BufferedUartTx` of `embassy-stm32` 0.6, refuse
/// a write that is longer than their transmit buffer, which must have at least this length. Most live frames are one part.
pub const WRITE_BYTES: usize = 96;

/// Interval at which a write that waits is polled. The same driver does not wake a write that waits for space in its buffer.
const WRITE_POLL: Duration = Duration::from_millis(1);

/// Exchanges messages with a host over a byte carrier. Never returns. Both directions run concurrently, so that a carrier that
/// is too slow for the live stream still delivers requests.
pub async fn serve(rx: impl Read, tx: impl Write, shared: &Shared) -> ! {
    join(receive(rx, shared), send(tx, shared)).await.0
}

async fn receive(mut rx: impl Read, shared: &Shared) -> ! {
    let mut decoder = Decoder::new();
    let mut received = [0; READ_BYTES];
    loop {
        let count = rx.read(&mut received).await;
        // A framing or overrun error of the port appears as a bad CRC.
        for &byte in count.ok().and_then(|count| received.get(..count)).unwrap_or_default() {
            if let Some(bytes) = decoder.push(byte) {
                let message = decode(bytes);
                if message.is_none() {
                    shared.count_bad_frame();
                }
                shared.receive(Carrier::Serial, message);
            } else if IS_MANAGED
                && byte == END
                && let Some(message) = decoder.management_message()
            {
                shared.receive_management(Carrier::Serial, message);
            }
            for _ in 0..core::mem::take(&mut decoder.bad_frames) {
                shared.count_bad_frame();
            }
        }
        shared.changed(Carrier::Serial).signal(());
    }
}

async fn send(mut tx: impl Write, shared: &Shared) -> ! {
    let (mut message, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
    loop {
        select(shared.changed(Carrier::Serial).wait(), Timer::after(IDLE)).await;
        shared.scan.heartbeats.progressed(Part::Link);
        loop {
            let len = if let Some(answer) = shared.next_management(Carrier::Serial, &mut message) {
                framed.first_chunk_mut().map_or(0, |lines| line::wrap(answer, lines))
            } else if let Some(message) = shared.next(Carrier::Serial, &mut message) {
                frame(message, &mut framed)
            } else {
                break;
            };
            if write(&mut tx, &framed[..len]).await.is_err() {
                shared.close(Carrier::Serial);
                break;
            }
            shared.scan.heartbeats.progressed(Part::Link);
        }
    }
}

/// Writes all bytes, part by part.
async fn write<W: Write>(tx: &mut W, bytes: &[u8]) -> Result<(), W::Error> {
    for part in bytes.chunks(WRITE_BYTES) {
        let mut written = pin!(tx.write_all(part));
        // A write is never dropped before it is complete, because with some drivers its bytes would be lost.
        loop {
            if let Either::First(result) = select(written.as_mut(), Timer::after(WRITE_POLL)).await {
                break result?;
            }
        }
    }
    Ok(())
}
