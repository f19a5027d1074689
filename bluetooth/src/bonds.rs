//! The insole's own identity key, bonds with centrals, and their storage.

use crate::MAX_BONDS;
use crc::{CRC_32_ISO_HDLC, Crc};
use heapless::Vec;
use plantar::firmware::ble::GattServer;
use plantar::storage::MAX_BONDS_BYTES;
use serde::{Deserialize, Serialize};
use trouble_host::prelude::*;

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// The identity key and the bonds, as they are stored. With an identity key, [`VERSION`] is stored, followed by this type.
/// Without one, [`BONDS_ONLY`] is stored, followed by the bonds alone. Both forms are encoded by `postcard` and end with the
/// CRC-32 of their bytes (little endian).
#[derive(Default, Serialize, Deserialize)]
pub struct Keys {
    /// The key with which bonded centrals resolve the insole's private addresses; `None` if it was not created yet, or if a
    /// central bonded with older firmware, which had no such key.
    pub identity_key: Option<[u8; 16]>,
    /// The bonds, the least recently used bond first.
    pub bonds: Vec<StoredBond, MAX_BONDS>,
}

/// The stored form of a bond.
#[derive(Serialize, Deserialize)]
pub struct StoredBond {
    /// The type of the central's address (0 public, 1 random).
    address_kind: u8,
    /// The identity address of the central, little endian.
    address: [u8; 6],
    /// The identity resolving key of the central; `None` if it has none.
    identity_key: Option<[u8; 16]>,
    /// The key with which the link is encrypted.
    long_term_key: [u8; 16],
}

impl StoredBond {
    fn new(bond: &BondInformation) -> Self {
        Self {
            address_kind: bond.identity.addr.kind.as_raw(),
            address: bond.identity.addr.addr.into_inner(),
            identity_key: bond.identity.irk.map(IdentityResolvingKey::to_le_bytes),
            long_term_key: bond.ltk.to_le_bytes(),
        }
    }

    /// The bond in the form of the Bluetooth host.
    pub fn bond(&self) -> BondInformation {
        let addr = Address::new(AddrKind::new(self.address_kind), BdAddr::new(self.address));
        let irk = self.identity_key.and_then(IdentityResolvingKey::from_le_bytes);
        let key = LongTermKey::from_le_bytes(self.long_term_key);
        // All bonds were made by Just Works pairing: encrypted, not authenticated.
        BondInformation::new(Identity { addr, irk }, key, SecurityLevel::Encrypted, true)
    }
}

/// Version of the stored form.
const VERSION: u8 = 2;
/// Version of the stored form with the bonds only. This form is still written while there is no identity key, so that older
/// firmware, which may be swapped back, finds its bonds.
const BONDS_ONLY: u8 = 1;

/// Loads the stored keys and bonds; none if they are damaged or of an unknown version.
pub fn load(insole: &dyn GattServer) -> Keys {
    let mut bytes = [0; MAX_BONDS_BYTES];
    let len = insole.load_bonds(&mut bytes);
    let stored = bytes.get(..len).and_then(<[u8]>::split_last_chunk::<4>);
    stored
        .filter(|(content, crc)| CRC.checksum(content) == u32::from_le_bytes(**crc))
        .and_then(|(content, _)| match content.split_first()? {
            (&VERSION, keys) => postcard::from_bytes(keys).ok(),
            (&BONDS_ONLY, bonds) => Some(Keys { identity_key: None, bonds: postcard::from_bytes(bonds).ok()? }),
            _ => None,
        })
        .unwrap_or_default()
}

/// Stores the keys and bonds, unless the same ones are already stored.
pub fn store(keys: &Keys, insole: &dyn GattServer) {
    let (mut bytes, mut before) = ([0; MAX_BONDS_BYTES], [0; MAX_BONDS_BYTES]);
    // Neither encoding nor adding the checksum can fail: the version, the insole's key, four bonds of at most 40 bytes each and
    // the checksum fit.
    let encoded = match keys.identity_key {
        Some(_) => postcard::to_slice(&(VERSION, keys), &mut bytes),
        None => postcard::to_slice(&(BONDS_ONLY, &keys.bonds), &mut bytes),
    };
    let Ok(len) = encoded.map(|used| used.len()) else { return };
    let crc = CRC.checksum(&bytes[..len]).to_le_bytes();
    let Some(place) = bytes.get_mut(len..len + crc.len()) else { return };
    place.copy_from_slice(&crc);
    let bytes = &bytes[..len + crc.len()];
    let before_len = insole.load_bonds(&mut before);
    if before.get(..before_len) != Some(bytes) {
        insole.save_bonds(bytes);
    }
}

/// Makes a bond the most recently used one, removes the least recently used bond if there are too many, and stores the bonds if
/// they changed. The keys of a pairing without a bond are ignored.
pub fn remember<C: Controller>(
    stack: &Stack<'_, C, DefaultPacketPool>,
    bond: BondInformation,
    insole: &dyn GattServer,
) {
    if !bond.is_bonded {
        return;
    }
    // The bond is removed and added again, so that it becomes the last one.
    let _ = stack.remove_bond_information(bond.identity);
    let _ = stack.add_bond_information(bond);
    let oldest = stack.with_bond_information(|bonds| match bonds {
        [oldest, ..] if bonds.len() > MAX_BONDS => Some(oldest.identity),
        _ => None,
    });
    if let Some(oldest) = oldest {
        let _ = stack.remove_bond_information(oldest);
    }
    let identity_key = load(insole).identity_key;
    stack.with_bond_information(|bonds| {
        store(&Keys { identity_key, bonds: bonds.iter().map(StoredBond::new).collect() }, insole);
    });
}
