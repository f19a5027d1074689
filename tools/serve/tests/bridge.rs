//! Tests of the bridge with pages over real sockets and insoles in memory: messages to pages, acknowledgements, slow pages.

mod page;

use client::{Carrier, Error, Framed, unix_us};
use page::{Page, TIMEOUT};
use parameters::{InsoleSize, Parameters};
use plantar::Side;
use plantar::pipeline::tissue::{AreaFilter, Identified, Tissue};
use plantar::protocol::session::{CommandResult, RECORD_QUEUE, Session};
use plantar::protocol::{
    ContactEllipse, Contents, Decoder, Ellipses, Hello, Live, MAX_FRAME, MAX_MESSAGE, Refusal, Reset, Status, Step,
    ToDevice, ToHost, decode, frame,
};
use serve::{Options, Source};
use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;

/// An insole in memory, with its end of the cable.
struct Insole {
    /// The insole's side of the session.
    link: Session,
    from_host: Decoder,
    /// Bytes that the host has not read yet.
    to_host: VecDeque<u8>,
    /// Numbers of the records whose acknowledgement the insole received.
    acknowledged: Vec<u32>,
    side: Side,
    /// Number of the present boot.
    boot: u32,
    is_unplugged: bool,
    /// Number of failed attempts to open the cable.
    failed_opens: u32,
}

impl Insole {
    /// Ends the session of the insole, as after this number of restarts, and plugs it in. With 0, the insole has not restarted.
    fn restart(&mut self, boots: u32) {
        self.link = Session::new();
        self.boot += boots;
        self.is_unplugged = false;
    }
}

/// A handle of an insole; as a byte stream it is the host's end of the cable. The condition variable signals changes.
#[derive(Clone)]
struct Cable(Arc<(Mutex<Insole>, Condvar)>);

impl Cable {
    fn new(side: Side) -> Self {
        let insole = Insole {
            link: Session::new(),
            from_host: Decoder::new(),
            to_host: VecDeque::new(),
            acknowledged: Vec::new(),
            side,
            boot: 1,
            is_unplugged: false,
            failed_opens: 0,
        };
        Self(Arc::new((Mutex::new(insole), Condvar::new())))
    }

    fn source(&self) -> Source {
        let cable = self.clone();
        Source { name: "memory".into(), open: Arc::new(move || cable.open()), tissue: None }
    }

    fn open(&self) -> Result<Box<dyn Carrier + Send>, Error> {
        let mut insole = self.0.0.lock().expect("no test panics here");
        if insole.is_unplugged {
            insole.failed_opens += 1;
            self.0.1.notify_all();
            return Err(Error::Open("the cable is unplugged".into()));
        }
        Ok(Box::new(Framed::new(self.clone())))
    }

    /// Unplugs the insole and waits for an attempt to open its cable.
    fn unplug(&self) {
        let mut insole = self.0.0.lock().expect("no test panics here");
        (insole.is_unplugged, insole.failed_opens) = (true, 0);
        let has_no_attempt = |insole: &mut Insole| insole.failed_opens == 0;
        let waited = self.0.1.wait_timeout_while(insole, TIMEOUT, has_no_attempt).expect("no test panics here");
        assert!(!waited.1.timed_out());
    }

    /// Calls `act` with the insole, and then puts the messages that the insole has to send on the cable.
    fn act<T>(&self, act: impl FnOnce(&mut Insole) -> T) -> T {
        let mut insole = self.0.0.lock().expect("no test panics here");
        let result = act(&mut insole);
        let hello = hello(insole.side);
        let contents = Contents { start: insole.boot, ..Contents::default() };
        let status = || Status { contents, ..Status::default() };
        let mut buffer = [0; MAX_MESSAGE];
        while let Some(message) = insole.link.next(&hello, status, &mut buffer) {
            let mut out = [0; MAX_FRAME];
            let len = frame(message, &mut out);
            insole.to_host.extend(&out[..len]);
        }
        self.0.1.notify_all();
        result
    }

    /// Sends a live frame, if the host has requested the live stream.
    fn live(&self) {
        self.act(|insole| {
            if let Some(sequence) = insole.link.next_live() {
                insole.link.push_live(Live { sequence, t_us: u64::from(sequence) * 10_000, ..Live::default() });
            }
        });
    }

    fn step(&self, number: u32) {
        let step = step(self.act(|insole| insole.side), number);
        self.act(|insole| insole.link.push_record(step));
    }

    /// Waits until the insole has a pending command.
    fn wait_for_command(&self) {
        let insole = self.0.0.lock().expect("no test panics here");
        let is_idle = |insole: &mut Insole| insole.link.command().is_none();
        let waited = self.0.1.wait_timeout_while(insole, TIMEOUT, is_idle).expect("no test panics here");
        assert!(!waited.1.timed_out());
    }

    /// Waits until the insole has a pending command, and answers it.
    fn answer_command(&self, answer: Result<CommandResult, Refusal>) {
        self.wait_for_command();
        self.act(|insole| insole.link.complete(answer));
    }

    /// Waits until the insole received the acknowledgement of a step. Returns false after a timeout.
    fn wait_for_acknowledgement(&self, number: u32) -> bool {
        let insole = self.0.0.lock().expect("no test panics here");
        let is_pending = |insole: &mut Insole| !insole.acknowledged.contains(&number);
        let waited = self.0.1.wait_timeout_while(insole, TIMEOUT, is_pending).expect("no test panics here");
        !waited.1.timed_out()
    }
}

impl Read for Cable {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let insole = self.0.0.lock().expect("no test panics here");
        if insole.is_unplugged {
            return Ok(0);
        }
        let wait = Duration::from_millis(10);
        let is_silent = |insole: &mut Insole| insole.to_host.is_empty();
        let (mut insole, timeout) = self.0.1.wait_timeout_while(insole, wait, is_silent).expect("no test panics here");
        if timeout.timed_out() { Err(io::ErrorKind::TimedOut.into()) } else { insole.to_host.read(buffer) }
    }
}

impl Write for Cable {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.act(|insole| {
            for &byte in bytes {
                let Some(message) = insole.from_host.push(byte).and_then(decode) else { continue };
                if let ToDevice::Acknowledge { number } = message {
                    insole.acknowledged.push(number);
                }
                insole.link.receive(message, insole_us());
            }
        });
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The time of the insoles' clock, us. It started 1.7e15 us after the Unix epoch.
fn insole_us() -> u64 {
    unix_us() - 1_700_000_000_000_000
}

fn hello(side: Side) -> Hello {
    Hello { side, tissue_id: 0, reset: Reset::Power, fault: None, ..testkit::hello() }
}

fn step(side: Side, number: u32) -> Step {
    Step { side, start_us: u64::from(number) * 1_000_000, ..testkit::step(number) }
}

/// Serves these insoles until the test program ends. Pages may not send parameters.
fn serve(cables: &[&Cable], record: Option<std::path::PathBuf>) -> SocketAddr {
    serve_sources(cables.iter().map(|cable| cable.source()).collect(), record, false)
}

/// As [`serve`]. `accepts_parameters` states whether pages may send parameters.
fn serve_sources(sources: Vec<Source>, record: Option<std::path::PathBuf>, accepts_parameters: bool) -> SocketAddr {
    serve_for(sources, record, accepts_parameters, Vec::new())
}

/// As [`serve_sources`]. Pages of `origins` may connect, too.
fn serve_for(
    sources: Vec<Source>,
    record: Option<std::path::PathBuf>,
    accepts_parameters: bool,
    origins: Vec<String>,
) -> SocketAddr {
    let folder = tempfile::tempdir().expect("a folder").keep();
    std::fs::write(folder.join("index.html"), "the page").expect("a page");
    let (ready, address) = channel();
    std::thread::spawn(move || {
        let listen = (Ipv4Addr::LOCALHOST, 0).into();
        let options = Options { listen, page: folder, origins, accepts_parameters, record, lsl: None };
        serve::serve(sources, &options, |local| ready.send(local).expect("the test waits")).expect("it serves");
    });
    address.recv_timeout(TIMEOUT).expect("it serves in time")
}

/// The host's end of a cable; reading panics once the value is true.
struct Faulty(Cable, Arc<AtomicBool>);

impl Read for Faulty {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        assert!(!self.1.load(Ordering::Relaxed), "a panic that the test requested");
        self.0.read(buffer)
    }
}

impl Write for Faulty {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// A browser has a separate store of steps for each name of this computer, so the server redirects all of its names to one. A
/// request for another port has come through a tunnel, and is not redirected.
#[test]
fn a_browser_that_uses_another_name_of_this_computer_is_redirected() {
    let address = serve(&[&Cable::new(Side::Left)], None);
    let get = |address: SocketAddr, host: &str| {
        let mut socket = std::net::TcpStream::connect(address).expect("a connection");
        write!(socket, "GET /?serve HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").expect("sent");
        let mut answer = String::new();
        socket.read_to_string(&mut answer).expect("an answer");
        answer
    };
    for name in ["localhost", "[::1]"] {
        let answer = get(address, &format!("{name}:{}", address.port()));
        assert!(
            answer.starts_with("HTTP/1.1 307") && answer.contains(&format!("http://{address}/?serve\r\n")),
            "{answer}"
        );
    }
    for host in [address.to_string(), "localhost:1".into()] {
        let answer = get(address, &host);
        assert!(answer.starts_with("HTTP/1.1 200") && answer.ends_with("the page"), "{answer}");
    }
    // The requests of a proxy name this computer, but the browser is elsewhere, so they are not redirected.
    let source = Cable::new(Side::Left).source();
    let proxied = serve_for(vec![source], None, false, vec!["https://insoles.example".into()]);
    let answer = get(proxied, &format!("localhost:{}", proxied.port()));
    assert!(answer.starts_with("HTTP/1.1 200") && answer.ends_with("the page"), "{answer}");
}

/// A server that serves only one of two feet would look as if it served both.
#[test]
fn a_panic_in_the_session_with_an_insole_ends_the_server() {
    let (left, right) = (Cable::new(Side::Left), Cable::new(Side::Right));
    let panics = Arc::new(AtomicBool::new(false));
    let (cable, is_faulty) = (left.clone(), panics.clone());
    let open = move || Ok(Box::new(Framed::new(Faulty(cable.clone(), is_faulty.clone()))) as Box<dyn Carrier + Send>);
    let faulty = Source { name: "left cable".into(), open: Arc::new(open), tissue: None };
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("index.html"), "the page").expect("a page");
    let listen = (Ipv4Addr::LOCALHOST, 0).into();
    let page = folder.path().into();
    let options = Options { listen, page, origins: Vec::new(), accepts_parameters: false, record: None, lsl: None };
    let (ended, end) = channel();
    std::thread::spawn(move || {
        let served = serve::serve(vec![faulty, right.source()], &options, |_| panics.store(true, Ordering::Relaxed));
        ended.send(served).expect("the test waits");
    });
    let error = end.recv_timeout(TIMEOUT).expect("it ends").expect_err("a foot is not served");
    assert!(error.to_string().contains("left cable"), "{error}");
}

#[tokio::test]
async fn two_pages_receive_both_feet_and_a_step_is_acknowledged_once_one_page_acknowledged_it() {
    let (left, right) = (Cable::new(Side::Left), Cable::new(Side::Right));
    let address = serve(&[&left, &right], None);
    let (mut one, mut other) = (Page::open(address).await, Page::open(address).await);
    for page in [&mut one, &mut other] {
        assert_eq!(page.hello(0).await.side, Side::Left);
        assert_eq!(page.hello(1).await.side, Side::Right);
        // The answer to this request arrives after the requested stream has started.
        page.status(1).await;
    }
    right.live();
    assert_eq!(one.live(1).await, other.live(1).await);

    right.step(0);
    assert_eq!(one.step(1).await.step, 0);
    assert_eq!(other.step(1).await.step, 0);
    right.act(|insole| assert_eq!(insole.acknowledged, [0; 0]));
    other.send(1, ToDevice::Acknowledge { number: 0 }).await;
    assert!(right.wait_for_acknowledgement(0));
    left.act(|insole| assert_eq!(insole.acknowledged, [0; 0]));
}

/// Waits until the insole streams the ellipses of one of every `every` frames, or no ellipses if `every` is 0. The bridge
/// requests a changed rate only after the next message from the insole, or after a timeout.
async fn wait_for_ellipses(cable: &Cable, page: &mut Page, every: u8) {
    let end = std::time::Instant::now() + TIMEOUT;
    while cable.act(|insole| insole.link.ellipses.every()) != every {
        assert!(std::time::Instant::now() < end, "the rate is {}", cable.act(|insole| insole.link.ellipses.every()));
        page.status(0).await;
    }
}

#[tokio::test]
async fn pages_read_the_layout_and_receive_ellipses_at_the_highest_rate_that_one_requested() {
    let cable = Cable::new(Side::Left);
    let cells: Vec<_> = (0..20).map(|i| testkit::cell(plantar::Region::Heel, i as f32, 20.0, 25.0)).collect();
    let cells: &'static [_] = cells.leak();
    cable.act(|insole| insole.link.set_layout(testkit::SETUP, cells, None));
    let address = serve(&[&cable], None);
    let (mut one, mut other) = (Page::open(address).await, Page::open(address).await);
    for page in [&mut one, &mut other] {
        let mut received = Vec::new();
        while received.len() < cells.len() {
            let first = received.len() as u16;
            page.send(0, ToDevice::GetSetupCells { first }).await;
            let part = page.find(0, |message| match message {
                ToHost::SetupCells { first: answered, cells } if answered == first => Some(cells),
                _ => None,
            });
            received.extend(part.await);
        }
        assert_eq!(received, cells);
    }
    one.send(0, ToDevice::StreamEllipses { every: 1 }).await;
    let refused = one.find(0, |message| if let ToHost::Refused(refusal) = message { Some(refusal) } else { None });
    assert_eq!(refused.await, Refusal::EllipseRate { every: 4 });

    one.send(0, ToDevice::StreamEllipses { every: 8 }).await;
    wait_for_ellipses(&cable, &mut one, 8).await;
    other.send(0, ToDevice::StreamEllipses { every: 4 }).await;
    wait_for_ellipses(&cable, &mut other, 4).await;
    let regions = [ContactEllipse { x_dmm: 300, y_dmm: 200, r_a_cmm: 100, r_b_cmm: 200, angle_ddeg: 0 }; 8];
    let sent = Ellipses { sequence: 0, t_us: 40_000, regions };
    cable.act(|insole| insole.link.ellipses.push(sent));
    for page in [&mut one, &mut other] {
        let received =
            page.find(0, |message| if let ToHost::Ellipses(ellipses) = message { Some(ellipses) } else { None });
        assert_eq!(received.await, sent);
    }
    drop(other);
    wait_for_ellipses(&cable, &mut one, 8).await;
    one.send(0, ToDevice::StreamEllipses { every: 0 }).await;
    wait_for_ellipses(&cable, &mut one, 0).await;
}

#[tokio::test]
async fn a_page_receives_the_time_of_the_insole() {
    let cable = Cable::new(Side::Left);
    let address = serve(&[&cable], None);
    let mut page = Page::open(address).await;
    page.hello(0).await;
    let before_us = insole_us();
    let device_us = loop {
        // The bridge answers only once it has estimated the clock of the insole.
        page.send(0, ToDevice::GetTime { host_us: 5 }).await;
        page.send(0, ToDevice::GetStatus).await;
        let answer = page
            .find(0, |message| match message {
                ToHost::Time { host_us, device_us } => Some(Some((host_us, device_us))),
                ToHost::Status(_) => Some(None),
                _ => None,
            })
            .await;
        if let Some((host_us, device_us)) = answer {
            assert_eq!(host_us, 5);
            break device_us;
        }
    };
    let timeout_us = TIMEOUT.as_micros() as u64;
    assert!((before_us..before_us + timeout_us).contains(&device_us), "{before_us} {device_us}");
}

#[tokio::test]
async fn a_page_that_connects_later_receives_the_steps_that_no_page_acknowledged() {
    let cable = Cable::new(Side::Left);
    let address = serve(&[&cable], None);
    cable.step(0);
    cable.step(1);
    let mut page = Page::open(address).await;
    assert_eq!((page.step(0).await.step, page.step(0).await.step), (0, 1));
    page.send(0, ToDevice::Acknowledge { number: 0 }).await;
    assert!(cable.wait_for_acknowledgement(0));
    drop(page);
    let mut page = Page::open(address).await;
    assert_eq!(page.step(0).await.step, 1);
}

#[tokio::test]
async fn a_slow_page_loses_counted_live_frames_and_no_step() {
    let cable = Cable::new(Side::Left);
    let folder = tempfile::tempdir().expect("a folder");
    let address = serve(&[&cable], Some(folder.path().join("walk.plantar")));
    let (mut slow, mut quick) = (Page::open(address).await, Page::open(address).await);
    slow.status(0).await;
    quick.status(0).await;
    // More steps than the insole holds in RAM.
    const STEPS: u32 = RECORD_QUEUE as u32 + 2;
    // These are far more frames than fit into the buffers of a socket, and the slow page reads none of them before the end.
    const FRAMES: u32 = 100_000;
    for sequence in 0..FRAMES {
        cable.live();
        if sequence == FRAMES / 2 {
            for number in 0..STEPS {
                cable.step(number);
                assert!(cable.wait_for_acknowledgement(number), "a recorded step is acknowledged");
            }
        }
        // Waiting for the quick page ensures that it loses no frame.
        assert_eq!(quick.live(0).await.sequence, sequence);
    }
    for number in 0..STEPS {
        assert_eq!(slow.step(0).await.step, number);
        slow.send(0, ToDevice::Acknowledge { number }).await;
    }
    let status = slow.status(0).await;
    assert_eq!((status.live_due, status.records_dropped), (FRAMES, 0));
    assert!(status.live_sent < FRAMES, "{} of {FRAMES} frames", status.live_sent);
    assert_eq!(quick.status(0).await.live_sent, FRAMES);
}

/// Two frames follow for each message that the page reads, so that there is always a next message for it.
#[tokio::test]
async fn the_requests_of_a_page_are_executed_although_it_is_too_slow_for_the_live_stream() {
    let cable = Cable::new(Side::Left);
    let address = serve(&[&cable], None);
    let mut slow = Page::open_with_small_buffer(address).await;
    let mut quick = Page::open(address).await;
    slow.status(0).await;
    quick.status(0).await;
    // These are more frames than fit into the buffers of the socket.
    for _ in 0..20_000 {
        cable.live();
        quick.live(0).await;
    }
    slow.send(0, ToDevice::GetStatus).await;
    let mut is_answered = false;
    for _ in 0..20_000 {
        if matches!(slow.next().await, (0, ToHost::Status(_))) {
            is_answered = true;
            break;
        }
        for _ in 0..2 {
            cable.live();
            quick.live(0).await;
        }
    }
    assert!(is_answered);
}

/// Returns the messages in a recording of one insole.
fn recorded(path: &Path) -> Vec<ToHost> {
    let bytes = std::fs::read(path).expect("a recording");
    let mut messages = Vec::new();
    let mut rest = &bytes[..];
    // The head of an entry contains the time, the index of the insole and the length of the message.
    while let Some((head, tail)) = rest.split_first_chunk::<7>() {
        assert_eq!(head[4], 0);
        let (message, tail) = tail.split_at(usize::from(u16::from_le_bytes([head[5], head[6]])));
        messages.push(decode::<ToHost>(message).expect("a message"));
        rest = tail;
    }
    messages
}

#[tokio::test]
async fn a_recorded_step_is_acknowledged_without_a_page() {
    let cable = Cable::new(Side::Right);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.plantar");
    serve(&[&cable], Some(path.clone()));
    cable.step(0);
    assert!(cable.wait_for_acknowledgement(0));
    let messages = recorded(&path);
    assert!(matches!(&messages[0], ToHost::Hello(hello) if hello.side == Side::Right));
    assert!(messages.contains(&ToHost::Step(step(Side::Right, 0))));
}

#[tokio::test]
async fn a_page_receives_nothing_while_the_insole_is_unplugged() {
    let cable = Cable::new(Side::Left);
    let address = serve(&[&cable], None);
    let mut page = Page::open(address).await;
    page.hello(0).await;
    page.status(0).await;
    cable.unplug();
    page.send(0, ToDevice::GetStatus).await;
    page.send(0, ToDevice::GetTime { host_us: 5 }).await;
    cable.act(|insole| insole.is_unplugged = false);
    let mut next = page.next().await.1;
    // The bridge requests the load of the day every second, so a page may receive it before the link is lost.
    while matches!(next, ToHost::DailyLoad(_)) {
        next = page.next().await.1;
    }
    assert!(matches!(next, ToHost::Hello(_)), "{next:?}");
    cable.live();
    page.live(0).await;
}

/// The acknowledgement is lost with the link, the insole restarts, and sends the step again.
#[tokio::test]
async fn a_repeated_step_is_acknowledged_again_and_recorded_once() {
    let cable = Cable::new(Side::Left);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.plantar");
    let address = serve(&[&cable], Some(path.clone()));
    cable.step(0);
    assert!(cable.wait_for_acknowledgement(0));
    cable.unplug();
    cable.act(|insole| {
        insole.acknowledged.clear();
        insole.restart(1);
        insole.link.push_record(Step { boots_since: 1, ..step(Side::Left, 0) });
    });
    assert!(cable.wait_for_acknowledgement(0));
    // A page receives the repeated step once, and then the next step.
    let mut page = Page::open(address).await;
    assert_eq!(page.step(0).await, Step { boots_since: 1, ..step(Side::Left, 0) });
    cable.step(1);
    assert_eq!(page.step(0).await.step, 1);
    assert!(cable.wait_for_acknowledgement(1));
    let steps = [0, 1].map(|number| ToHost::Step(step(Side::Left, number)));
    let is_step = |message: &ToHost| matches!(message, ToHost::Step(_));
    assert_eq!(recorded(&path).into_iter().filter(is_step).collect::<Vec<_>>(), steps);
}

/// After its restarts, the insole does not repeat a step that was acknowledged because it is in the recording. The time of the
/// step cannot be converted with the clock of the present boot, so pages must receive it as one of an earlier boot.
#[tokio::test]
async fn a_page_receives_a_recorded_step_from_before_two_restarts_as_one_of_an_earlier_boot() {
    let cable = Cable::new(Side::Left);
    let folder = tempfile::tempdir().expect("a folder");
    let address = serve(&[&cable], Some(folder.path().join("walk.plantar")));
    cable.step(0);
    assert!(cable.wait_for_acknowledgement(0));
    cable.unplug();
    cable.act(|insole| insole.restart(2));
    let mut page = Page::open(address).await;
    assert_eq!(page.step(0).await, Step { boots_since: 2, ..step(Side::Left, 0) });
    cable.step(1);
    assert_eq!(page.step(0).await, step(Side::Left, 1));
}

/// No page has stored the step when the insole is connected again: first in the same boot, and then after one and two restarts.
#[tokio::test]
async fn pages_receive_a_repeated_step_with_its_number_of_boots_and_acknowledge_it() {
    let cable = Cable::new(Side::Left);
    let address = serve(&[&cable], None);
    let mut page = Page::open(address).await;
    page.first_hello(0).await;
    cable.step(0);
    assert_eq!(page.step(0).await, step(Side::Left, 0));
    for (boots, boots_since) in [(0, 0), (1, 1), (2, 3)] {
        cable.unplug();
        let repeated = Step { boots_since, ..step(Side::Left, 0) };
        cable.act(|insole| {
            insole.restart(boots);
            insole.link.push_record(repeated);
        });
        page.hello(0).await;
        assert_eq!(page.step(0).await, repeated);
        assert_eq!(Page::open(address).await.step(0).await, repeated);
    }
    page.send(0, ToDevice::Acknowledge { number: 0 }).await;
    assert!(cable.wait_for_acknowledgement(0));
}

#[test]
fn a_port_in_use_leaves_no_recording() {
    let taken = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("index.html"), "the page").expect("a page");
    let record = folder.path().join("walk.plantar");
    let options = Options {
        listen: taken.local_addr().expect("an address"),
        page: folder.path().into(),
        origins: Vec::new(),
        accepts_parameters: false,
        record: Some(record.clone()),
        lsl: None,
    };
    let error = serve::serve(vec![Cable::new(Side::Left).source()], &options, |_| {}).expect_err("the port is in use");
    assert!(matches!(error, serve::Error::Listen(..)) && !record.exists(), "{error}");
}

/// If the recording cannot be written, a step is acknowledged to the insole once a page acknowledged it.
#[tokio::test]
#[cfg(target_os = "linux")]
async fn a_full_disk_loses_no_step() {
    let cable = Cable::new(Side::Right);
    let address = serve(&[&cable], Some("/dev/full".into()));
    let mut page = Page::open(address).await;
    cable.step(0);
    assert_eq!(page.step(0).await.step, 0);
    cable.act(|insole| assert_eq!(insole.acknowledged, [0; 0]));
    page.send(0, ToDevice::Acknowledge { number: 0 }).await;
    assert!(cable.wait_for_acknowledgement(0));
}

#[tokio::test]
async fn a_page_cannot_change_the_settings_of_an_insole() {
    let cable = Cable::new(Side::Left);
    let address = serve(&[&cable], None);
    let mut page = Page::open(address).await;
    page.hello(0).await;
    // Both values are valid for an insole, and differ from its own.
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    // The bridge ignores the first request, and refuses the second one.
    page.send(0, ToDevice::SetClock { unix_us: 1_600_000_000_000_000 }).await;
    page.send(0, ToDevice::SetTissue(tissue)).await;
    page.find(0, |m| (m == ToHost::Refused(Refusal::NotUnderstood)).then_some(())).await;
    cable.act(|insole| {
        assert_eq!(insole.link.tissue().id, Tissue::NONE.id);
        // The clock is the one that the bridge has set.
        assert!(insole.link.unix_us(insole_us()).is_some_and(|us| us > 1_700_000_000_000_000));
    });
}

#[tokio::test]
async fn a_page_replaces_the_parameters_if_the_server_accepts_them() {
    let cable = Cable::new(Side::Left);
    let address = serve_sources(vec![cable.source()], None, true);
    let (mut page, mut other) = (Page::open(address).await, Page::open(address).await);
    page.hello(0).await;
    other.hello(0).await;
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    // The bridge checks parameters as the insole does; invalid ones do not reach the insole.
    page.send(0, ToDevice::SetTissue(Tissue { id: tissue.id ^ 1, ..tissue })).await;
    page.find(0, |m| (m == ToHost::Refused(Refusal::TissueId)).then_some(())).await;
    // The answer of the insole is passed on, whether it stored the parameters or not.
    for (answer, expected) in [
        (Err(Refusal::NotStored), ToHost::Refused(Refusal::NotStored)),
        (Ok(CommandResult::Stored), ToHost::Tissue(tissue)),
    ] {
        page.send(0, ToDevice::SetTissue(tissue)).await;
        cable.answer_command(answer);
        page.find(0, |m| (m == expected).then_some(())).await;
        assert_eq!(cable.act(|insole| insole.link.tissue().id), tissue.id);
    }
    // Other settings are still refused.
    other.send(0, ToDevice::Restart).await;
    other.find(0, |m| (m == ToHost::Refused(Refusal::NotUnderstood)).then_some(())).await;
}

#[tokio::test]
async fn pages_learn_how_the_parameters_were_identified() {
    let cable = Cable::new(Side::Left);
    // Without a contact rule, an insole refuses identified parameters.
    cable.act(|insole| insole.link.set_layout(testkit::SETUP, &[], None));
    let address = serve_sources(vec![cable.source()], None, true);
    let mut pages = [Page::open(address).await, Page::open(address).await];
    let answer = |message| if let ToHost::Identified(identified) = message { Some(identified) } else { None };
    for page in &mut pages {
        page.hello(0).await;
        page.send(0, ToDevice::GetIdentified).await;
        assert_eq!(page.find(0, answer).await, None);
    }
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    let contact = testkit::SETUP.contact;
    let identified =
        Identified { contact, filter: AreaFilter::Direct, side: Some(Side::Left), steps: 20, regions: 0b101 };
    pages[0].send(0, ToDevice::SetIdentifiedTissue { tissue, identified }).await;
    cable.answer_command(Ok(CommandResult::Stored));
    // The answer to the former parameters is not repeated for the new ones.
    pages[0].find(0, |message| (message == ToHost::Tissue(tissue)).then_some(())).await;
    pages[0].send(0, ToDevice::GetIdentified).await;
    assert_eq!(pages[0].find(0, answer).await, Some(identified));
    // The other page receives the new parameters, and all answers of the insole.
    pages[1].find(0, |message| (message == ToHost::Tissue(tissue)).then_some(())).await;
    pages[1].find(0, |message| (message == ToHost::Identified(Some(identified))).then_some(())).await;
    // A page that opens its session later receives the answer, too.
    let mut later = Page::open(address).await;
    later.hello(0).await;
    later.send(0, ToDevice::GetIdentified).await;
    assert_eq!(later.find(0, answer).await, Some(identified));
}

/// Serves an insole to a page that has sent parameters. Returns the address of the server, the page and the parameters.
async fn sent_parameters(cable: &Cable) -> (SocketAddr, Page, Tissue) {
    let address = serve_sources(vec![cable.source()], None, true);
    let mut page = Page::open(address).await;
    page.hello(0).await;
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    page.send(0, ToDevice::SetTissue(tissue)).await;
    (address, page, tissue)
}

#[tokio::test]
async fn the_refusal_of_a_snooze_is_not_the_answer_to_new_parameters() {
    let cable = Cable::new(Side::Left);
    let (_, mut page, tissue) = sent_parameters(&cable).await;
    cable.wait_for_command();
    // An insole without a layout refuses to snooze alerts.
    cable.act(|insole| insole.link.refuse(Refusal::NoLayout));
    cable.answer_command(Ok(CommandResult::Stored));
    let answer = |message| matches!(message, ToHost::Tissue(_) | ToHost::Refused(_)).then_some(message);
    assert_eq!(page.find(0, answer).await, ToHost::Tissue(tissue));
}

/// The server sends the parameters of the source in the first session, as `plantar serve` does with an emulated insole. It does
/// not send them again after the reconnection.
#[tokio::test]
async fn parameters_of_a_page_remain_in_force_after_a_reconnection() {
    let cable = Cable::new(Side::Left);
    let [of_source, of_page] = ["42", "36"].map(|size| {
        let size: InsoleSize = size.parse().expect("a shoe size");
        Parameters::typical(size).tissue()
    });
    let source = Source { tissue: Some(of_source), ..cable.source() };
    let insole = cable.clone();
    let answering = std::thread::spawn(move || insole.answer_command(Ok(CommandResult::Stored)));
    let address = serve_sources(vec![source], None, true);
    answering.join().expect("no panic");
    let mut page = Page::open(address).await;
    assert_eq!(page.first_hello(0).await.tissue_id, of_source.id);
    page.send(0, ToDevice::SetTissue(of_page)).await;
    cable.answer_command(Ok(CommandResult::Stored));
    page.find(0, |m| (m == ToHost::Tissue(of_page)).then_some(())).await;

    cable.unplug();
    cable.act(|insole| insole.is_unplugged = false);
    assert_eq!(page.hello(0).await.tissue_id, of_page.id);
    assert_eq!(cable.act(|insole| *insole.link.tissue()), of_page);
}

#[tokio::test]
async fn a_request_that_was_lost_with_the_link_does_not_block_later_ones() {
    let cable = Cable::new(Side::Left);
    let address = serve_sources(vec![cable.source()], None, true);
    let mut page = Page::open(address).await;
    page.first_hello(0).await;
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    cable.unplug();
    page.send(0, ToDevice::SetTissue(tissue)).await;
    // The bridge tries twice more to open the cable, so it has seen the request while the link is lost.
    for _ in 0..2 {
        cable.unplug();
    }
    cable.act(|insole| insole.is_unplugged = false);
    page.hello(0).await;
    page.send(0, ToDevice::SetTissue(tissue)).await;
    cable.answer_command(Ok(CommandResult::Stored));
    page.find(0, |m| (m == ToHost::Tissue(tissue)).then_some(())).await;
}

#[tokio::test]
async fn a_later_page_receives_parameters_that_the_insole_could_not_store() {
    let cable = Cable::new(Side::Left);
    let (address, mut page, tissue) = sent_parameters(&cable).await;
    cable.answer_command(Err(Refusal::NotStored));
    page.find(0, |m| (m == ToHost::Refused(Refusal::NotStored)).then_some(())).await;
    assert_eq!(Page::open(address).await.hello(0).await.tissue_id, tissue.id);
}

#[tokio::test]
async fn a_page_receives_the_counters_of_the_insole() {
    let cable = Cable::new(Side::Left);
    let address = serve(&[&cable], None);
    let mut page = Page::open(address).await;
    page.hello(0).await;
    cable.act(|insole| insole.link.count_dropped(40));
    loop {
        page.send(0, ToDevice::GetStatus).await;
        let status = page.find(0, |m| if let ToHost::Status(status) = m { Some(status) } else { None }).await;
        // The bridge has asked the insole again, and has set its clock.
        if status.records_dropped == 40 {
            assert!(status.is_clock_set);
            break;
        }
    }
}

/// In a frame of a foreign page, the browser would give the page another store, and the wearer's steps would be lost.
#[test]
fn the_page_may_not_be_shown_in_a_frame() {
    let mut stream = TcpStream::connect(serve(&[&Cable::new(Side::Left)], None)).expect("a connection");
    stream.write_all(b"GET / HTTP/1.0\r\n\r\n").expect("sent");
    let mut response = String::new();
    stream.read_to_string(&mut response).expect("text");
    assert!(response.contains("content-security-policy: frame-ancestors 'none'\r\n"), "{response}");
    assert!(response.contains("x-frame-options: DENY\r\n"), "{response}");
}

#[tokio::test]
async fn a_page_from_another_origin_cannot_connect() {
    let cable = Cable::new(Side::Left);
    let address = serve(&[&cable], None);
    let mut request = format!("ws://{address}/insoles").into_client_request().expect("a request");
    request.headers_mut().insert("origin", "https://evil.example".parse().expect("a header"));
    let refused = tokio_tungstenite::connect_async(request).await.expect_err("it is refused");
    assert!(refused.to_string().contains("403"), "{refused}");
}

/// The page that a browser has cached under another name of this computer is not redirected.
#[tokio::test]
async fn a_page_under_another_name_of_this_computer_cannot_connect() {
    let cable = Cable::new(Side::Left);
    let address = serve(&[&cable], None);
    for (host, is_refused) in [(format!("localhost:{}", address.port()), true), (address.to_string(), false)] {
        let mut request = format!("ws://{address}/insoles").into_client_request().expect("a request");
        request.headers_mut().insert("host", host.parse().expect("a header"));
        request.headers_mut().insert("origin", format!("http://{host}").parse().expect("a header"));
        assert_eq!(tokio_tungstenite::connect_async(request).await.is_err(), is_refused, "{host}");
    }
}
