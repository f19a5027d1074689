//! Makes the link of an emulated board available at a network port.

use emulator::{Board, Link};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::spawn;
use std::time::Duration;

/// The connection of the current host, which a test can cut.
pub type Cable = Arc<Mutex<Option<TcpStream>>>;

/// Connects the link of a board to one host after the other. Returns the address at which hosts connect, and the connection of
/// the current host.
pub fn forward(board: &Board) -> (String, Cable) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    let link = board.link().expect("the board has a link");
    let cable = Cable::default();
    let current = cable.clone();
    spawn(move || {
        for host in listener.incoming() {
            let host = host.expect("a host");
            *current.lock().expect("no panic") = host.try_clone().ok();
            let link = || link.try_clone().expect("a handle");
            let (mut from_board, to_host, is_closed) =
                (link(), host.try_clone().expect("a socket"), AtomicBool::new(false));
            std::thread::scope(|scope| {
                scope.spawn(|| copy_until(&is_closed, &mut from_board, to_host));
                // An error means, as the end of the bytes does, that the host has closed the connection.
                let _ = io::copy(&mut &host, &mut link());
                is_closed.store(true, Ordering::Relaxed);
            });
        }
    });
    (address, cable)
}

/// Copies the bytes of the board to the host until the host has closed the connection. The board may send none for a long time,
/// as after a restart.
fn copy_until(is_closed: &AtomicBool, from_board: &mut Link, mut to_host: TcpStream) {
    from_board.set_read_timeout(Some(Duration::from_millis(20))).expect("the time is not zero");
    let mut bytes = [0; 4096];
    while !is_closed.load(Ordering::Relaxed) {
        match from_board.read(&mut bytes) {
            Ok(count @ 1..) if to_host.write_all(&bytes[..count]).is_ok() => {}
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            _ => break,
        }
    }
}
