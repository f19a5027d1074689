//! A simulated insole that listens on a TCP port, for tests of other programs. The command is
//! `cargo run -p testkit --example simulated_insole -- STEPS`. The insole serves one host after the other with the code of the
//! firmware's session. It accepts parameters, but computes nothing with them. It sends STEPS steps, a load bout and an alert; of
//! more than four steps only the last four, because the session holds six records. The program prints the address on which it
//! listens, and then the record number of each acknowledgement that arrives.

use plantar::protocol::session::{CommandResult, Session};
use plantar::protocol::{Decoder, MAX_FRAME, MAX_MESSAGE, ToDevice, decode, frame};
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let steps: u32 =
        std::env::args().nth(1).ok_or("the number of steps is missing: simulated_insole STEPS")?.parse()?;
    let listener = TcpListener::bind("127.0.0.1:0")?;
    println!("{}", listener.local_addr()?);
    let mut session = Session::new();
    // Without a contact rule of its own, the insole would refuse identified parameters.
    session.set_layout(testkit::SETUP, &[], None);
    (0..steps).for_each(|number| session.push_record(testkit::step(number)));
    session.push_record(testkit::bout(steps));
    session.push_record(testkit::alert(steps + 1));
    for host in listener.incoming() {
        // A host may close its connection at any time.
        let _ = serve(&mut session, host?);
    }
    Ok(())
}

/// Serves a host until the host disconnects. While the host requests live frames, one follows each block of bytes that is read.
fn serve(session: &mut Session, mut host: TcpStream) -> io::Result<()> {
    let mut decoder = Decoder::new();
    let mut received = [0; 256];
    loop {
        let count = host.read(&mut received)?;
        if count == 0 {
            return Ok(());
        }
        for &byte in &received[..count] {
            let Some(message) = decoder.push(byte).and_then(decode::<ToDevice>) else { continue };
            if let ToDevice::Acknowledge { number } = message {
                println!("acknowledged {number}");
            }
            session.receive(message, device_us(&message));
            if session.command().is_some() {
                session.complete(Ok(CommandResult::Stored));
            }
        }
        if let Some(number) = session.next_live() {
            session.push_live(testkit::live(number));
        }
        let (mut buffer, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
        while let Some(message) = session.next(&testkit::hello(), testkit::status, &mut buffer) {
            let len = frame(message, &mut framed);
            host.write_all(&framed[..len])?;
        }
    }
}

/// The insole's time at which a message arrives, us: 0, except for a request for the time. Such a request arrives at the moment
/// at which the host sent it, and the insole's time began 1.7e9 s after the Unix epoch. If the host's clock is before that, the
/// time is 0, too.
fn device_us(message: &ToDevice) -> u64 {
    match message {
        ToDevice::GetTime { host_us } => host_us.saturating_sub(1_700_000_000_000_000),
        _ => 0,
    }
}
