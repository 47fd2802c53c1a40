//! What somebody sees who watches a finger in a browser: what is shown, who may see it, and the page.
//!
//! `shown`: everything that a page shows, made of what comes, and the messages for each page; `access`: whether a request is
//! answered; `server`: the one thread with an async runtime, which serves the page (`page.html`, without libraries) and a
//! stream of messages. `shown` and `access` know neither clock nor network.
//!
//! A page is sent what is the newest when its turn comes, and all that it has not had of the past half minute with it. So
//! a page that reads slowly, or never, waits for itself alone: nothing piles up for it.

pub(crate) mod access;
pub(crate) mod server;
pub(crate) mod shown;
