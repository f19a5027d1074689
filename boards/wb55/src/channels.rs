//! The channels between the two cores (IPCC). While the flag of a channel is set, its buffers belong to the receiver, and
//! otherwise to the sender.
//!
//! `embassy-stm32` 0.6 has a driver, too, but its interrupt handlers serve the channels 1 to 5 only. Data packets use channel 6
//! (in this file index 5, because indices count from 0): the first packet that had to wait would cause an interrupt that no
//! handler masks, so it would occur again without end. `embassy-stm32-wpan`, the driver of the same project for this radio, is
//! an empty reservation (0.0.0) on the crate registry.

use core::future::poll_fn;
use core::sync::atomic::{Ordering, fence};
use core::task::Poll;
use cortex_m::peripheral::NVIC;
use embassy_stm32::pac::ipcc::regs::CxMr;
use embassy_stm32::pac::{self, Interrupt, interrupt};
use embassy_stm32::peripherals::IPCC;
use embassy_stm32::{Peri, rcc};
use embassy_sync::waitqueue::AtomicWaker;
use wb55_mailbox::channels::{CHANNELS, Masks};

/// Bluetooth commands to the radio's core, and its events.
pub const BLE: usize = 0;
/// System commands to the radio's core, and its system events.
pub const SYSTEM: usize = 1;
/// Packets that are returned to the radio's core.
pub const RELEASE: usize = 3;
/// Data packets to the radio's core.
pub const DATA: usize = 5;

/// This core and the radio's core, as indices of the registers.
const THIS: usize = 0;
const RADIO: usize = 1;

/// For each channel, the waker of the task that waits until the radio's core has filled it.
static FILLED: [AtomicWaker; CHANNELS] = [const { AtomicWaker::new() }; CHANNELS];
/// For each channel, the waker of the task that waits until the radio's core has emptied it.
static EMPTIED: [AtomicWaker; CHANNELS] = [const { AtomicWaker::new() }; CHANNELS];

/// Starts the radio's core, with all interrupts of channels masked.
pub fn start(_: Peri<'static, IPCC>) {
    rcc::enable_and_reset::<IPCC>();
    pac::PWR.cr4().modify(|w| w.set_c2boot(true));
    pac::IPCC.cpu(THIS).cr().modify(|w| {
        w.set_rxoie(true);
        w.set_txfie(true);
    });
    // SAFETY: the wakers that the handlers use are static.
    unsafe {
        NVIC::unmask(Interrupt::IPCC_C1_RX);
        NVIC::unmask(Interrupt::IPCC_C1_TX);
    }
}

/// Changes the masks of the channels.
fn with_masks<T>(change: impl FnOnce(&mut Masks) -> T) -> T {
    cortex_m::interrupt::free(|_| {
        let register = pac::IPCC.cpu(THIS).mr();
        let mut masks = Masks(register.read().0);
        let result = change(&mut masks);
        register.write_value(CxMr(masks.0));
        result
    })
}

/// Wakes the tasks that wait for these channels.
fn wake(wakers: &[AtomicWaker; CHANNELS], channels: u32) {
    wakers.iter().enumerate().filter(|(channel, _)| channels >> channel & 1 == 1).for_each(|(_, waker)| waker.wake());
}

#[interrupt]
fn IPCC_C1_RX() {
    wake(&FILLED, with_masks(|masks| masks.take_filled(pac::IPCC.cpu(RADIO).sr().read().0)));
}

#[interrupt]
fn IPCC_C1_TX() {
    wake(&EMPTIED, with_masks(|masks| masks.take_emptied(pac::IPCC.cpu(THIS).sr().read().0)));
}

/// Waits until the radio's core has emptied a channel.
pub async fn emptied(channel: usize) {
    poll_fn(|context| {
        EMPTIED[channel].register(context.waker());
        if pac::IPCC.cpu(THIS).sr().read().chf(channel) {
            // If the channel was emptied meanwhile, the interrupt occurs now.
            with_masks(|masks| masks.await_emptied(channel));
            return Poll::Pending;
        }
        Poll::Ready(())
    })
    .await;
}

/// Waits until a channel is empty, lets `fill` write its buffer, and passes the buffer to the radio's core.
pub async fn send(channel: usize, fill: impl FnOnce()) {
    emptied(channel).await;
    fill();
    fence(Ordering::Release);
    pac::IPCC.cpu(THIS).scr().write(|w| w.set_chs(channel, true));
}

/// Waits until the radio's core has filled a channel, calls `take`, and empties the channel. Returns the value that `take`
/// returned; if `take` returned `None`, waits again.
pub async fn receive<T>(channel: usize, mut take: impl FnMut() -> Option<T>) -> T {
    loop {
        poll_fn(|context| {
            FILLED[channel].register(context.waker());
            if !pac::IPCC.cpu(RADIO).sr().read().chf(channel) {
                with_masks(|masks| masks.await_filled(channel));
                return Poll::Pending;
            }
            Poll::Ready(())
        })
        .await;
        fence(Ordering::Acquire);
        let taken = take();
        fence(Ordering::Release);
        pac::IPCC.cpu(THIS).scr().write(|w| w.set_chc(channel, true));
        if let Some(taken) = taken {
            return taken;
        }
    }
}
