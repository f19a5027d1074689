//! Messages between insole and host, and the session that exchanges them.
//!
//! A message is encoded by `postcard`; its first byte identifies its kind. A carrier is the link of a session: the
//! serial port or Bluetooth. On the serial port, a frame is the message and its CRC-32 (little endian), COBS-encoded and ended by
//! a zero byte. Over GATT, a message is sent in fragments.
//!
//! Version rule: framing, [`Hello`] and [`ToDevice::Connect`] never change. A change of any other message raises [`MAJOR`]; a
//! message added at the end of an enum raises [`MINOR`]. Peers of different majors exchange hellos only.

mod alert;
mod bout;
mod calibration;
mod cell_stream;
mod cells;
mod codec;
mod command;
pub mod current_time;
mod ellipses;
pub mod fragment;
pub mod gatt;
mod hello;
mod identity;
mod live;
mod live_counter;
mod load_record;
pub mod mcuboot;
mod messages;
mod quantities;
mod refusal;
pub mod session;
mod settings;
mod status;
mod step;
pub mod update;

pub use alert::Alert;
pub use bout::{Bout, BoutRegion};
pub use calibration::{BLOCK_CELLS, CALIBRATION_BLOCKS, CalibrationBlock, CalibrationId};
pub use cells::{Capacity, CellCoder, CellFrame, CellStream, KEY_INTERVAL, MAX_PACKED, Resolution};
pub use codec::{Decoder, EncodeError, MAX_FRAME, MAX_MESSAGE, decode, encode, frame};
pub use ellipses::{ContactEllipse, EllipseSender, Ellipses};
pub use hello::{Hello, MAX_FAULT_TEXT, Reset};
pub use identity::{Identity, Serial};
pub use live::{Live, LiveRegion, MAX_LIVE};
pub use live_counter::LiveCounter;
pub use load_record::LoadRecord;
pub use messages::{MAJOR, MINOR, SETUP_CELLS, ToDevice, ToHost};
pub use quantities::{COUNT, Flag, Quantity};
pub use refusal::Refusal;
pub use settings::{SCALE, SETTABLE_PERIOD_US, Settings};
pub use status::{Contents, Radio, SUFFICIENT_SUPPLY_MV, Status};
pub use step::{Step, StepFoot, StepRegion};
