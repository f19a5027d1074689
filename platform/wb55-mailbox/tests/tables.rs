//! Compares the tables with ST's publications: STM32CubeWB's mbox_def.h, tl.h and shci.h, and AN5289.

use std::mem::{offset_of, size_of};
use wb55_mailbox::{BleInit, COMMAND, DATA, EVENT, Memory, POOL_BYTES, Packet, References, Shared};

#[test]
fn tables_have_the_published_layout() {
    assert_eq!(size_of::<References>(), 40, "MB_RefTable_t");
    assert_eq!(offset_of!(Shared, references), 0);
    assert_eq!((offset_of!(References, ble), offset_of!(References, system)), (4, 12));
    assert_eq!((offset_of!(References, memory), offset_of!(References, ble_lld)), (16, 36));
    assert_eq!((offset_of!(Memory, pool), offset_of!(Memory, free), size_of::<Memory>()), (8, 16, 28));
    assert!(size_of::<Shared>() <= 10 * 1024, "the size of the linker's region");
}

#[test]
fn packets_have_the_published_sizes() {
    assert_eq!(offset_of!(Packet<COMMAND>, h4), 8, "TL_PacketHeader_t");
    assert_eq!(
        (8 + COMMAND, 8 + EVENT, 8 + DATA),
        (267, 266, 264),
        "TL_CmdPacket_t, TL_EvtPacket_t, TL_AclDataPacket_t"
    );
    assert_eq!(POOL_BYTES, 4 * 268, "CFG_TLBLE_EVT_QUEUE_LENGTH packets in whole words");
}

#[test]
fn parameters_of_bluetooth_have_the_published_layout() {
    assert_eq!(size_of::<BleInit>(), 47, "SHCI_C2_Ble_Init_Cmd_Param_t");
    let places = [
        (offset_of!(BleInit, links), 14, "NumOfLinks"),
        (offset_of!(BleInit, peripheral_ppm), 20, "PeripheralSca"),
        (offset_of!(BleInit, sleep_clock), 23, "LsSource"),
        (offset_of!(BleInit, most_event), 24, "MaxConnEventLength"),
        (offset_of!(BleInit, options), 31, "Options"),
        (offset_of!(BleInit, advertising_bytes), 38, "max_adv_data_len"),
        (offset_of!(BleInit, core_version), 44, "ble_core_version"),
    ];
    for (place, published, name) in places {
        assert_eq!(place, published, "{name}");
    }
    let bytes = BleInit::PERIPHERAL.bytes();
    assert_eq!((bytes[14], bytes[23], bytes[31]), (1, 4, 1));
}
