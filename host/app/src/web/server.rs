//! The one thread that serves the page, and the way to it.
//!
//! Routes: `/` the page, `/events` the messages as server-sent events, `/wish` takes `tare` or `mark` by POST. Messages go
//! out 30 times a second to whoever reads them: each stream makes its next one when its connection takes it.
//!
//! Errors: those of the network when the port is taken. Later ones end a connection, never the run.

use std::convert::Infallible;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use axum::Router;
use axum::extract::{Request, State};
use axum::http::header::{self, HeaderName, HeaderValue};
use axum::http::{HeaderMap, Method, StatusCode};
use axum::middleware::{self, Next};
use axum::response::sse::{Event, Sse};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use futures_util::stream::{self, Stream};
use tokio::sync::oneshot;
use tokio::time::{Interval, MissedTickBehavior, interval};

use super::access::{Access, Asked, Refusal};
use super::shown::{Cursor, Device, Shown};
use crate::screen::terminal::Wish;

/// Messages a second.
const FRAMES_HZ: u32 = 30;

/// Pages that are served at once; each costs a thousandth of a core.
const PAGES_MAX: usize = 32;

/// Wishes that wait at most; more are refused.
const WISHES_MAX: usize = 16;

/// Longest wish, bytes.
const WISH_BYTES_MAX: usize = 64;

/// How long pages have at the end to take the last message.
const LAST_WORDS: Duration = Duration::from_millis(300);

/// The page. It asks for nothing from anywhere but `/events` and `/wish`.
const PAGE: &str = include_str!("page.html");

/// What the page may do: nothing from anywhere else, and nobody may frame it.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What all requests share.
#[derive(Debug)]
struct Shared {
    shown: Arc<Mutex<Shown>>,
    access: Access,
    wishes: SyncSender<Wish>,
    pages: AtomicUsize,
}

/// The page, served until this is dropped.
#[derive(Debug)]
pub(crate) struct Server {
    shown: Arc<Mutex<Shown>>,
    wishes: Receiver<Wish>,
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

/// The way to what is shown, for whoever has something to show.
#[derive(Clone, Debug)]
pub(crate) struct Board(Arc<Mutex<Shown>>);

impl Board {
    /// Changes what is shown.
    pub(crate) fn update<T>(&self, change: impl FnOnce(&mut Shown) -> T) -> T {
        change(&mut lock(&self.0))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Server {
    /// Serves what is shown at this address.
    ///
    /// # Errors
    /// If the address cannot be listened on.
    pub(crate) fn start(at: SocketAddr, access: Access, shown: Shown) -> io::Result<Self> {
        let listener = TcpListener::bind(at)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let shown = Arc::new(Mutex::new(shown));
        let (wished, wishes) = sync_channel(WISHES_MAX);
        let shared = Shared { shown: Arc::clone(&shown), access, wishes: wished, pages: AtomicUsize::new(0) };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
        let (stop, stopped) = oneshot::channel();
        let thread = thread::Builder::new().name("palpate web".to_owned()).spawn(move || {
            let served = runtime.block_on(serve(listener, Arc::new(shared), stopped));
            if let Err(error) = served {
                tracing::warn!("the page is served no more: {error}");
            }
            // Whoever does not read is left behind.
            runtime.shutdown_background();
        })?;
        Ok(Self { shown, wishes, address, stop: Some(stop), thread: Some(thread) })
    }

    /// Where it listens.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// The way to what is shown.
    pub(crate) fn board(&self) -> Board {
        Board(Arc::clone(&self.shown))
    }

    /// What was asked for since the last call.
    pub(crate) fn wishes(&self) -> Vec<Wish> {
        self.wishes.try_iter().collect()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        lock(&self.shown).device = Device::Over;
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A panic in the thread has been reported by it.
            let _ = thread.join();
        }
    }
}

async fn serve(listener: TcpListener, shared: Arc<Shared>, stopped: oneshot::Receiver<()>) -> io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let routes = Router::new()
        .route("/", get(|| async { Html(PAGE) }))
        .route("/events", get(events))
        .route("/wish", post(wish))
        .layer(middleware::from_fn_with_state(Arc::clone(&shared), guarded))
        .with_state(shared);
    let served = tokio::spawn(async move { axum::serve(listener, routes).await });
    // Dropped or used, it is the end.
    let _ = stopped.await;
    tokio::time::sleep(LAST_WORDS).await;
    served.abort();
    Ok(())
}

/// Lets a request through, if it may, and says with the answer what browsers shall keep to.
async fn guarded(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let headers = request.headers();
    let asked = Asked {
        host: text(headers, &header::HOST),
        origin: text(headers, &header::ORIGIN),
        fetch_site: text(headers, &HeaderName::from_static("sec-fetch-site")),
        query: request.uri().query(),
        acts: request.method() != Method::GET,
        is_page: request.uri().path() == "/",
    };
    let mut response = match shared.access.check(&asked) {
        Ok(()) => next.run(request).await,
        Err(refusal) => {
            let status = match refusal {
                Refusal::Token => StatusCode::UNAUTHORIZED,
                Refusal::Host | Refusal::Origin => StatusCode::FORBIDDEN,
            };
            (status, refusal.in_words()).into_response()
        }
    };
    let kept_to = [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ];
    response.headers_mut().extend(kept_to.map(|(name, value)| (name, HeaderValue::from_static(value))));
    response
}

/// A header's text; one that is no text is as good as empty, which suits nothing.
fn text<'h>(headers: &'h HeaderMap, name: &HeaderName) -> Option<&'h str> {
    headers.get(name).map(|value| value.to_str().unwrap_or_default())
}

/// A page that is served.
struct Page {
    shared: Arc<Shared>,
    had: Cursor,
    interval: Interval,
    is_over: bool,
}

impl Page {
    fn open(shared: Arc<Shared>) -> Option<Self> {
        let more = |pages: usize| (pages < PAGES_MAX).then_some(pages + 1);
        shared.pages.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).ok()?;
        let mut interval = interval(Duration::from_secs(1) / FRAMES_HZ);
        interval.set_missed_tick_behavior(MissedTickBehavior::Skip);
        Some(Self { shared, had: Cursor::default(), interval, is_over: false })
    }

    async fn next(mut self) -> Option<(Result<Event, Infallible>, Self)> {
        if self.is_over {
            return None;
        }
        self.interval.tick().await;
        let (message, had) = {
            let shown = lock(&self.shared.shown);
            self.is_over = shown.device == Device::Over;
            shown.message(self.had)
        };
        self.had = had;
        Some((Ok(Event::default().data(message.to_string())), self))
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.shared.pages.fetch_sub(1, Ordering::Relaxed);
    }
}

async fn events(
    State(shared): State<Arc<Shared>>,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Response> {
    let Some(page) = Page::open(shared) else {
        let words = format!("{PAGES_MAX} pages are open: close one\n");
        return Err((StatusCode::SERVICE_UNAVAILABLE, words).into_response());
    };
    Ok(Sse::new(stream::unfold(page, Page::next)))
}

async fn wish(State(shared): State<Arc<Shared>>, request: Request) -> (StatusCode, &'static str) {
    let Ok(body) = axum::body::to_bytes(request.into_body(), WISH_BYTES_MAX).await else {
        return (StatusCode::PAYLOAD_TOO_LARGE, "a wish is a word: tare or mark\n");
    };
    let wish = match &*body {
        b"tare" => Wish::Tare,
        b"mark" => Wish::Mark,
        _ => return (StatusCode::BAD_REQUEST, "a wish is a word: tare or mark\n"),
    };
    match shared.wishes.try_send(wish) {
        Ok(()) => (StatusCode::ACCEPTED, "wished\n"),
        Err(TrySendError::Full(_)) => (StatusCode::TOO_MANY_REQUESTS, "too many wishes wait: is there a device?\n"),
        Err(TrySendError::Disconnected(_)) => (StatusCode::GONE, "palpate has ended\n"),
    }
}
