//! A client for the tests of the bridge between insoles and pages (`plantar serve`). It exchanges messages with the bridge over a
//! real WebSocket, as the web page does.

use futures_util::{SinkExt, StreamExt};
use plantar::protocol::{Hello, Live, MAJOR, MAX_MESSAGE, MINOR, Status, Step, ToDevice, ToHost, decode, encode};
use std::net::SocketAddr;
use std::time::Duration;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};

/// The timeout of every wait in the tests, long enough for a busy machine.
pub const TIMEOUT: Duration = Duration::from_secs(30);

type Socket = WebSocketStream<MaybeTlsStream<tokio::net::TcpStream>>;

/// A connection to the bridge, like that of a page. Insoles are numbered 0 and 1.
pub struct Page(Socket);

impl Page {
    /// Opens a WebSocket, and requests a session and the live stream of both insoles.
    pub async fn open(address: SocketAddr) -> Self {
        let url = format!("ws://{address}/insoles");
        let (socket, _) = tokio_tungstenite::connect_async(url).await.expect("the WebSocket opens");
        Self::start(socket).await
    }

    /// As [`Page::open`], with a small buffer for received messages.
    pub async fn open_with_small_buffer(address: SocketAddr) -> Self {
        let stream = tokio::net::TcpSocket::new_v4().expect("a socket");
        stream.set_recv_buffer_size(4096).expect("the size is valid");
        let stream = MaybeTlsStream::Plain(stream.connect(address).await.expect("the server listens"));
        let url = format!("ws://{address}/insoles");
        let (socket, _) = tokio_tungstenite::client_async(url, stream).await.expect("the WebSocket opens");
        Self::start(socket).await
    }

    async fn start(socket: Socket) -> Self {
        let mut page = Self(socket);
        for insole in [0, 1] {
            page.send(insole, ToDevice::Connect { major: MAJOR, minor: MINOR }).await;
            page.send(insole, ToDevice::Stream { live: true }).await;
        }
        page
    }

    /// Sends a message to an insole.
    pub async fn send(&mut self, insole: u8, message: ToDevice) {
        let mut buffer = [0; MAX_MESSAGE];
        let message = encode(&message, &mut buffer).expect("the message fits");
        let message = Message::Binary([&[insole], &*message].concat().into());
        self.0.send(message).await.expect("the message is sent");
    }

    /// Returns the next message of any insole, after the number of the insole that sent it.
    pub async fn next(&mut self) -> (u8, ToHost) {
        let message = tokio::time::timeout(TIMEOUT, self.0.next()).await.expect("a message arrives in time");
        let bytes = message.expect("the socket is open").expect("a message").into_data();
        (bytes[0], decode(&bytes[1..]).expect("a valid message"))
    }

    /// Returns the first value that `select` returns for a message of this insole; skips all messages before it.
    pub async fn find<T>(&mut self, insole: u8, select: impl Fn(ToHost) -> Option<T>) -> T {
        loop {
            let (from, message) = self.next().await;
            if from == insole
                && let Some(found) = select(message)
            {
                return found;
            }
        }
    }

    pub async fn hello(&mut self, insole: u8) -> Hello {
        self.find(insole, |m| if let ToHost::Hello(hello) = m { Some(hello) } else { None }).await
    }

    /// Returns the first hello. Skips the messages after it up to the answer to a request for the status, perhaps also a second
    /// hello of the same session: when an insole connects, the bridge opens the session of each page, also of one that has not
    /// sent its connect request yet, and then answers this request as well.
    pub async fn first_hello(&mut self, insole: u8) -> Hello {
        let hello = self.hello(insole).await;
        self.status(insole).await;
        hello
    }

    pub async fn live(&mut self, insole: u8) -> Live {
        self.find(insole, |m| if let ToHost::Live(live) = m { Some(live) } else { None }).await
    }

    pub async fn step(&mut self, insole: u8) -> Step {
        self.find(insole, |m| if let ToHost::Step(step) = m { Some(step) } else { None }).await
    }

    /// Requests the status of an insole, and returns the answer.
    pub async fn status(&mut self, insole: u8) -> Status {
        self.send(insole, ToDevice::GetStatus).await;
        self.find(insole, |m| if let ToHost::Status(status) = m { Some(status) } else { None }).await
    }
}
