//! The derived channels of a recording as they happen, for Foxglove, Lichtblick and PlotJuggler: a server of Foxglove's
//! WebSocket protocol, with the same schemas and encodings as the file.
//!
//! The server's threads are those of the crate `foxglove`; a client that is slow loses the oldest messages.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;

use foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, Schema, WebSocketServer, WebSocketServerHandle};
use miette::{IntoDiagnostic as _, WrapErr as _};

use super::channels::Kind;

/// Messages that wait for a client at most: a second of every channel.
const BACKLOG: usize = 4096;

/// What is served.
#[derive(Debug)]
pub(super) struct Live {
    context: Arc<Context>,
    channels: BTreeMap<Kind, Arc<RawChannel>>,
    /// Of forces.
    pub(super) unit: &'static str,
    server: Option<WebSocketServerHandle>,
}

impl Live {
    /// Serves at this address; port 0 takes one that is free. The port is told too.
    pub(super) fn start(at: SocketAddr) -> miette::Result<(Self, u16)> {
        let context = Context::new();
        let server = WebSocketServer::new()
            .name(format!("palpate {}", env!("CARGO_PKG_VERSION")))
            .bind(at.ip().to_string(), at.port())
            .message_backlog_size(BACKLOG)
            .context(&context)
            .start_blocking()
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot serve Foxglove's protocol at {at}"))?;
        let port = server.port();
        Ok((Self { context, channels: BTreeMap::new(), unit: "N", server: Some(server) }, port))
    }

    /// Sends a message to whoever asked for its channel.
    pub(super) fn put(&mut self, kind: Kind, unix_ns: u64, data: &[u8]) {
        if matches!(kind, Kind::Received | Kind::Sent) {
            return;
        }
        let channel = match self.channels.get(&kind) {
            Some(channel) => channel,
            None => {
                let described = kind.channel(self.unit);
                let schema =
                    Schema::new(described.schema_name, described.schema_encoding, described.schema.into_bytes());
                let built = ChannelBuilder::new(described.topic)
                    .message_encoding(described.message_encoding)
                    .schema(schema)
                    .metadata(described.metadata)
                    .context(&self.context)
                    .build_raw();
                match built {
                    Ok(channel) => self.channels.entry(kind).or_insert(channel),
                    Err(error) => {
                        tracing::warn!("{} is not served: {error}", kind.topic());
                        return;
                    }
                }
            }
        };
        channel.log_with_meta(data, PartialMetadata::with_log_time(unix_ns));
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        if let Some(server) = self.server.take() {
            // Whoever looks on is told so by the end of the connection, and not waited for.
            drop(server.stop());
        }
    }
}
