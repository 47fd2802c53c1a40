//! The terminal of the screen: a thread that draws and listens, and the way back to what the terminal was.
//!
//! While the screen is on, notes and warnings are held back from standard error and shown on it ([`crate::messages`]); they
//! are written once it is off. It goes off with [`Screen`], at a panic in any thread, and before an interruption ends the
//! process.
//!
//! Errors: those of the terminal. One that goes away while it is drawn on counts as the wish to stop.

use std::io::{self, IsTerminal as _, Stdout};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, Once, PoisonError, TryLockError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::crossterm::terminal::{EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode};
use ratatui::crossterm::{cursor, execute};

use super::state::State;
use super::view;
use crate::live::interrupt;
use crate::messages;

/// Between two frames: as fast as an eye follows numbers, and a hundredth of a core.
const FRAME: Duration = Duration::from_millis(66);

/// Lines of what was told that a frame may want.
const TOLD_LINES: usize = 8;

/// How long the way back waits for a frame that is being written, to a terminal that may have stopped reading.
const FRAME_PATIENCE: Duration = Duration::from_millis(300);

/// Whether the screen is on. Held while a frame is drawn.
static ON: Mutex<bool> = Mutex::new(false);

/// What a person asks for by a key. The wish to quit is an interruption.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wish {
    /// A new tare.
    Tare,
    /// A recording to begin, or the one that is written to end.
    Record,
    /// A mark in the recording.
    Mark,
}

/// Whether somebody is there who sees a screen and has keys.
pub(crate) fn is_there() -> bool {
    let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    io::stdin().is_terminal() && io::stdout().is_terminal() && !is_dumb
}

/// A screen that is on.
#[derive(Debug)]
pub(crate) struct Screen {
    state: Arc<Mutex<State>>,
    wishes: Receiver<Wish>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Screen {
    /// Shows this state from now on, and what becomes of it.
    ///
    /// # Errors
    /// If the terminal cannot be set.
    pub(crate) fn start(state: State) -> io::Result<Self> {
        static HOOK: Once = Once::new();
        HOOK.call_once(|| {
            let before = std::panic::take_hook();
            std::panic::set_hook(Box::new(move |panic| {
                restore();
                before(panic);
            }));
        });
        let terminal = turn_on()?;
        let (state, is_over) = (Arc::new(Mutex::new(state)), Arc::new(AtomicBool::new(false)));
        let (wish, wishes) = channel();
        let shared = (Arc::clone(&state), Arc::clone(&is_over));
        let thread = thread::Builder::new().name("palpate screen".to_owned()).spawn(move || {
            let (state, is_over) = shared;
            if let Err(error) = show(terminal, &state, &is_over, &wish) {
                restore();
                tracing::warn!("the terminal cannot be drawn on any more: {error}");
                interrupt::request();
            }
        });
        let thread = thread.inspect_err(|_| restore())?;
        Ok(Self { state, wishes, is_over, thread: Some(thread) })
    }

    /// Changes what is shown.
    pub(crate) fn update(&self, change: impl FnOnce(&mut State)) {
        change(&mut lock(&self.state));
    }

    /// What was asked for since the last call.
    pub(crate) fn wishes(&self) -> Vec<Wish> {
        self.wishes.try_iter().collect()
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in the thread has been reported by it.
            let _ = thread.join();
        }
        restore();
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn turn_on() -> io::Result<Terminal<CrosstermBackend<Stdout>>> {
    let mut on = lock(&ON);
    enable_raw_mode()?;
    *on = true;
    messages::hold();
    drop(on);
    let made = execute!(io::stdout(), EnterAlternateScreen, cursor::Hide)
        .and_then(|()| Terminal::new(CrosstermBackend::new(io::stdout())));
    made.inspect_err(|_| restore())
}

/// Makes the terminal what it was before, if the screen is on, and tells what was held back.
pub(crate) fn restore() {
    let begun = Instant::now();
    let mut on = loop {
        match ON.try_lock() {
            Ok(on) => break Some(on),
            Err(TryLockError::Poisoned(on)) => break Some(on.into_inner()),
            Err(TryLockError::WouldBlock) if begun.elapsed() > FRAME_PATIENCE => break None,
            Err(TryLockError::WouldBlock) => thread::sleep(Duration::from_millis(5)),
        }
    };
    if on.as_deref() == Some(&false) {
        return;
    }
    if let Some(on) = on.as_deref_mut() {
        *on = false;
    }
    // Nothing is left to do where the terminal does not take it.
    let _ = execute!(io::stdout(), LeaveAlternateScreen, cursor::Show);
    let _ = disable_raw_mode();
    messages::release();
}

/// Draws and listens until it is over.
fn show(
    mut terminal: Terminal<CrosstermBackend<Stdout>>,
    state: &Mutex<State>,
    is_over: &AtomicBool,
    wish: &Sender<Wish>,
) -> io::Result<()> {
    while !is_over.load(Ordering::Relaxed) {
        let mut shown = lock(state).clone();
        shown.told = messages::held(TOLD_LINES);
        {
            let on = lock(&ON);
            if !*on {
                return Ok(());
            }
            terminal.draw(|frame| view::draw(frame, &shown))?;
        }
        let next = Instant::now() + FRAME;
        while event::poll(next.saturating_duration_since(Instant::now()))? {
            let Event::Key(key) = event::read()? else { continue };
            if key.kind == KeyEventKind::Release {
                continue;
            }
            let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
            let wished = match key.code {
                KeyCode::Char('c' | 'd') if is_control => None,
                KeyCode::Char('q') | KeyCode::Esc => None,
                KeyCode::Char('t') => Some(Wish::Tare),
                KeyCode::Char('r') => Some(Wish::Record),
                KeyCode::Char('m' | ' ') => Some(Wish::Mark),
                _ => continue,
            };
            match wished {
                // Where nobody takes it any more it is over.
                Some(wished) => drop(wish.send(wished)),
                None => interrupt::request(),
            }
        }
    }
    Ok(())
}
