//! The event of a new connection, LE Enhanced Connection Complete, with a peer that has a private address.

/// Length of the event with its H4 byte, bytes.
const LEN: usize = 34;
/// The H4 byte of an event, the code of an LE event, the length of its parameters, and the code of this event.
const HEAD: [u8; 4] = [super::H4_EVENT, 0x3e, 31, 0x0a];
/// Index of the status; 0 is a success.
const STATUS: usize = 4;
/// Index of the type of the peer's address.
const PEER_TYPE: usize = 8;
/// The type of a random address; private addresses are random.
const RANDOM: u8 = 1;
/// Index of the peer's address.
const PEER: usize = 9;
/// Index of the private address with which the peer has connected.
const PEER_PRIVATE: usize = 21;
/// Length of an address.
const ADDRESS: usize = 6;
/// The address that ST's controllers have reported for a peer with an address that they could not resolve.
const UNRESOLVED: [u8; ADDRESS] = [0xff; ADDRESS];

/// The corrected event, with the private address of the peer in place of the peer's address, if the radio's core has not reported
/// the latter; otherwise `None`. ST's wireless firmware has reported ff:ff:ff:ff:ff:ff for a private address that it did not
/// resolve (Zephyr issue 19509), by which the Bluetooth host would not find the bond.
pub fn with_peer_address(h4: &[u8]) -> Option<[u8; LEN]> {
    let mut event: [u8; LEN] = h4.try_into().ok()?;
    if !event.starts_with(&HEAD) || event[STATUS] != 0 || event[PEER..PEER + ADDRESS] != UNRESOLVED {
        return None;
    }
    event.copy_within(PEER_PRIVATE..PEER_PRIVATE + ADDRESS, PEER);
    event[PEER_TYPE] = RANDOM;
    Some(event)
}
