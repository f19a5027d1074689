//! The session over a byte carrier.

use super::shared::{Carrier, Shared};
use crate::protocol::{Decoder, MAX_FRAME, MAX_MESSAGE, decode, frame};
use embassy_futures::select::{Either3, select3};
use embassy_time::{Duration, Timer};
use embedded_io_async::{Read, Write};

/// Longest time without a heartbeat of an idle link.
const IDLE: Duration = Duration::from_millis(200);

/// Exchanges messages with a host over a byte carrier. Never returns.
pub async fn serve(mut rx: impl Read, mut tx: impl Write, shared: &Shared) -> ! {
    let mut decoder = Decoder::new();
    let mut received = [0; 64];
    let (mut message, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
    loop {
        let event = select3(rx.read(&mut received), shared.changed(Carrier::Serial).wait(), Timer::after(IDLE)).await;
        shared.scan.heartbeats.link_progressed();
        if let Either3::First(count) = event {
            // A framing or overrun error of the port appears as a bad CRC.
            let bytes = count.ok().and_then(|count| received.get(..count)).unwrap_or_default();
            receive(bytes, &mut decoder, shared);
        }
        while let Some(message) = shared.next(Carrier::Serial, &mut message) {
            let len = frame(message, &mut framed);
            if tx.write_all(&framed[..len]).await.is_err() {
                shared.close(Carrier::Serial);
                break;
            }
        }
    }
}

fn receive(bytes: &[u8], decoder: &mut Decoder, shared: &Shared) {
    for &byte in bytes {
        if let Some(bytes) = decoder.push(byte) {
            let message = decode(bytes);
            if message.is_none() {
                shared.count_bad_frame();
            }
            shared.receive(Carrier::Serial, message);
        }
        for _ in 0..core::mem::take(&mut decoder.bad_frames) {
            shared.count_bad_frame();
        }
    }
}
