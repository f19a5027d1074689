//! The correction of the event of a new connection. The offsets are those of the Bluetooth Core Specification, vol. 4, part E,
//! 7.7.65.10.

use wb55_mailbox::connected::with_peer_address;

/// The event of a connection with these addresses of the peer: the reported one, and the private one.
fn connected(status: u8, peer_type: u8, peer: [u8; 6], private: [u8; 6]) -> Vec<u8> {
    let head = [4, 0x3e, 31, 0x0a, status, 0x40, 0, 1, peer_type];
    let local = [9; 6];
    let timing = [0x18, 0, 0, 0, 0xf4, 1, 0];
    [&head[..], &peer, &local, &private, &timing].concat()
}

#[test]
fn a_peer_that_was_not_resolved_has_its_private_address() {
    let private = [1, 2, 3, 4, 5, 0x46];
    let corrected = with_peer_address(&connected(0, 0, [0xff; 6], private)).expect("no address was reported");
    assert_eq!(corrected.to_vec(), connected(0, 1, private, private));
}

#[test]
fn other_events_are_not_changed() {
    let private = [1, 2, 3, 4, 5, 0x46];
    let unresolved = connected(0, 0, [0xff; 6], private);
    // A known address, a connection that failed, a packet that was cut off, and an event of another kind.
    assert_eq!(with_peer_address(&connected(0, 2, [7; 6], private)), None);
    assert_eq!(with_peer_address(&connected(0x3e, 0, [0xff; 6], private)), None);
    assert_eq!(with_peer_address(&unresolved[..33]), None);
    let other = [&[4, 0x3e, 31, 0x01], &unresolved[4..]].concat();
    assert_eq!(with_peer_address(&other), None);
}
