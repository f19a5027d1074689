//! Makes the link of an emulated board available at a network port.

use emulator::Board;
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, spawn};

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
            let link = || link.try_clone().expect("a socket");
            let to_host = copy(link(), host.try_clone().expect("a socket"));
            let _ = copy(host, link()).join();
            // The thread `to_host` ends when it cannot write the next byte of the live stream to the closed connection.
            let _ = to_host.join();
        }
    });
    (address, cable)
}

/// Copies bytes in a thread of its own until one of the two connections is closed.
fn copy(mut from: impl Read + Send + 'static, mut to: impl Write + Send + 'static) -> JoinHandle<io::Result<u64>> {
    spawn(move || io::copy(&mut from, &mut to))
}
