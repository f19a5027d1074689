//! HTTP: the page's files, and the WebSocket at `/insoles`.

use crate::hub::{Hub, Page};
use crate::origin::{self, is_allowed, is_other_name};
use crate::{Error, Options};
use axum::Router;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, HOST, HeaderName, ORIGIN, X_FRAME_OPTIONS};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Redirect, Response};
use axum::routing::any;
use futures_util::FutureExt;
use std::net::SocketAddr;
use std::sync::Arc;
use tokio::net::{TcpListener, TcpSocket};
use tokio::runtime::Runtime;
use tokio::sync::mpsc::Receiver;
use tower_http::services::ServeDir;
use tower_http::set_header::SetResponseHeaderLayer;

/// Size of the system's send buffer for a page, bytes: about one second of messages from two feet. While the buffer is full, the
/// page's sessions drop live frames.
const SEND_BUFFER: u32 = 16 * 1024;
/// Largest size of a message from a page, bytes. Longer ones end the connection.
const MAX_REQUEST: usize = 512;
/// Largest number of connections that wait to be accepted.
const BACKLOG: u32 = 64;

#[derive(Clone)]
struct Served {
    hub: Arc<Hub>,
    origins: Arc<[String]>,
    canonical: Option<SocketAddr>,
}

/// A server that listens.
pub(crate) struct Listening {
    runtime: Runtime,
    listener: TcpListener,
}

impl Listening {
    /// Listens at this address.
    pub fn at(address: SocketAddr) -> Result<Self, Error> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let listener = runtime.block_on(async { listen(address) }).map_err(|e| Error::Listen(address, e))?;
        Ok(Self { runtime, listener })
    }

    /// Serves until a signal ends the program, or `panics` receives the name of an insole that is no longer served.
    pub fn run(
        self,
        hub: Arc<Hub>,
        options: &Options,
        mut panics: Receiver<String>,
        ready: impl FnOnce(SocketAddr),
    ) -> Result<(), Error> {
        let address = self.listener.local_addr()?;
        ready(address);
        let router = router(hub, options, origin::canonical_address(address));
        self.runtime.block_on(async {
            tokio::select! {
                ended = axum::serve(self.listener, router) => Ok(ended?),
                () = end_signal() => Ok(()),
                Some(name) = panics.recv() => Err(Error::Bridge(name)),
            }
        })
    }
}

fn listen(address: SocketAddr) -> std::io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    // On Windows, this option would let two programs listen on the same port.
    socket.set_reuseaddr(cfg!(unix))?;
    // The accepted connections inherit these two options.
    socket.set_send_buffer_size(SEND_BUFFER)?;
    socket.set_nodelay(true)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// `canonical` is the address of this server for the browsers of this computer; see [`origin::canonical_address`].
fn router(hub: Arc<Hub>, options: &Options, canonical: Option<SocketAddr>) -> Router {
    // With other origins, the requests may come from a proxy of such an origin, which names this computer for browsers elsewhere.
    let canonical = canonical.filter(|_| options.origins.is_empty());
    let page = Router::new()
        .fallback_service(ServeDir::new(&options.page))
        .layer(middleware::from_fn_with_state(canonical, to_canonical));
    let header = |name: HeaderName, value| SetResponseHeaderLayer::overriding(name, HeaderValue::from_static(value));
    Router::new()
        .route("/insoles", any(insoles))
        .with_state(Served { hub, origins: options.origins.clone().into(), canonical })
        .fallback_service(page)
        // Makes the browser check for a newer build at each visit.
        .layer(header(CACHE_CONTROL, "no-cache"))
        // In a frame of a foreign page, the browser gives the page a store of its own. Steps that the framed page acknowledges
        // would be lost for the wearer.
        .layer(header(CONTENT_SECURITY_POLICY, "frame-ancestors 'none'"))
        .layer(header(X_FRAME_OPTIONS, "DENY"))
}

/// Redirects a browser that uses another name of this computer to the canonical address. Otherwise, its store of the page would
/// be another one, and steps that this page acknowledges would be missing in the wearer's.
async fn to_canonical(State(canonical): State<Option<SocketAddr>>, request: Request, next: Next) -> Response {
    let host = request.headers().get(HOST).and_then(|host| host.to_str().ok());
    match canonical.filter(|canonical| host.is_some_and(|host| is_other_name(host, *canonical))) {
        Some(canonical) => Redirect::temporary(&format!("http://{canonical}{}", request.uri())).into_response(),
        None => next.run(request).await,
    }
}

async fn insoles(State(served): State<Served>, headers: HeaderMap, upgrade: WebSocketUpgrade) -> Response {
    let texts = |name: HeaderName| headers.get_all(name).iter().map(|value| value.to_str().unwrap_or_default());
    let origins: Vec<&str> = texts(ORIGIN).collect();
    let host = texts(HOST).next();
    // A page that the browser has cached under another name was not redirected.
    let has_other_name = served.canonical.zip(host).is_some_and(|(canonical, host)| is_other_name(host, canonical));
    if !is_allowed(&origins, host, &served.origins) || (has_other_name && !origins.is_empty()) {
        return (StatusCode::FORBIDDEN, "pages from other origins may not connect").into_response();
    }
    let page = served.hub.join();
    upgrade.max_message_size(MAX_REQUEST).max_frame_size(MAX_REQUEST).on_upgrade(|socket| forward(socket, page))
}

/// Forwards messages in both directions until the page disconnects.
async fn forward(mut socket: WebSocket, mut page: Page) {
    loop {
        let received = match page.next() {
            Some(message) => {
                if socket.send(Message::Binary(message.into())).await.is_err() {
                    return;
                }
                // On a connection that is too slow for the live streams, there is always a next message. The requests of the page
                // are executed nevertheless.
                socket.recv().now_or_never()
            }
            None => tokio::select! {
                () = page.changed() => None,
                message = socket.recv() => Some(message),
            },
        };
        match received {
            Some(Some(Ok(Message::Binary(bytes)))) => page.receive(&bytes),
            Some(Some(Ok(Message::Close(_)) | Err(_)) | None) => return,
            Some(Some(Ok(_))) | None => {}
        }
    }
}

#[cfg(unix)]
async fn end_signal() {
    use std::io::{self, IsTerminal};
    use tokio::signal::unix::{SignalKind, signal};
    let (Ok(mut interrupt), Ok(mut terminate)) = (signal(SignalKind::interrupt()), signal(SignalKind::terminate()))
    else {
        return std::future::pending().await;
    };
    // A terminal that closes sends this signal. `nohup`, which protects a program from it, replaces all streams to the terminal.
    let is_on_terminal = io::stdin().is_terminal() || io::stdout().is_terminal() || io::stderr().is_terminal();
    let mut hangup = if is_on_terminal { signal(SignalKind::hangup()).ok() } else { None };
    let hung_up = async {
        match &mut hangup {
            Some(hangup) => _ = hangup.recv().await,
            None => std::future::pending().await,
        }
    };
    tokio::select! {
        _ = interrupt.recv() => {}
        _ = terminate.recv() => {}
        () = hung_up => {}
    }
}

#[cfg(not(unix))]
async fn end_signal() {
    let _ = tokio::signal::ctrl_c().await;
}
