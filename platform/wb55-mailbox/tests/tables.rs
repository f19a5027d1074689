//! Compares the tables and packets of the mailbox, and the parameters in them, with ST's publications: STM32CubeWB's mbox_def.h,
//! tl.h and shci.h, and AN5289.

use std::mem::{offset_of, size_of};
use wb55_mailbox::system::{SystemEvent, reply_status};
use wb55_mailbox::{BLE_INIT_OPCODE, BleInit, COMMAND, DATA, EVENT, Memory, POOL_BYTES, Packet, References, Shared};

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
    assert_eq!(size_of::<BleInit>(), 47, "SHCI_C2_Ble_Init_Cmd_Param_t of STM32CubeWB 1.23");
    let offsets = [
        (offset_of!(BleInit, links), 14, "NumOfLinks"),
        (offset_of!(BleInit, peripheral_ppm), 20, "PeripheralSca"),
        (offset_of!(BleInit, sleep_clock), 23, "LsSource"),
        (offset_of!(BleInit, most_event), 24, "MaxConnEventLength"),
        (offset_of!(BleInit, options), 31, "Options"),
        (offset_of!(BleInit, advertising_bytes), 38, "max_adv_data_len"),
        (offset_of!(BleInit, core_version), 44, "ble_core_version"),
    ];
    for (offset, published, name) in offsets {
        assert_eq!(offset, published, "{name}");
    }
    let bytes = BleInit::PERIPHERAL.bytes();
    // One link; the sleep clock is HSE / 1024 (bit 2); the link layer only (bit 0).
    assert_eq!((bytes[14], bytes[23], bytes[31]), (1, 4, 1));
}

/// The layouts of TL_EvtPacket_t, TL_AsynchEvt_t and TL_CcEvt_t, with the codes of shci.h.
#[test]
fn events_and_replies_of_the_system_are_decoded() {
    let event = |code: u16, parameter: u8| {
        let [low, high] = code.to_le_bytes();
        SystemEvent::decode(&[0x12, 0xff, 3, low, high, parameter])
    };
    assert_eq!(event(0x9200, 0), Some(SystemEvent::Ready), "WIRELESS_FW_RUNNING");
    assert_eq!(event(0x9200, 1), Some(SystemEvent::UpdateService), "FUS_FW_RUNNING");
    assert_eq!(event(0x9201, 7), Some(SystemEvent::Error(7)), "SHCI_SUB_EVT_ERROR_NOTIF");
    assert_eq!(event(0x9204, 0), Some(SystemEvent::Other(0x9204)));
    for damaged in [&[0x12, 0xff, 3, 0, 0x92][..], &[0x12, 0xff], &[], &[4, 0xff, 3, 0, 0x92, 0]] {
        assert!(!matches!(SystemEvent::decode(damaged), Some(SystemEvent::Ready)), "{damaged:?}");
    }
    let reply = [0x11, 0x0e, 4, 1, 0x66, 0xfc, 0x12];
    assert_eq!(reply_status(&reply, BLE_INIT_OPCODE), Some(0x12));
    assert_eq!(reply_status(&reply, 0xfc67), None, "the reply to another command");
    assert_eq!(reply_status(&reply[..6], BLE_INIT_OPCODE), None);
}
