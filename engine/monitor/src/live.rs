//! The WebSocket of a live run: each viewer reads on in the store at its own pace.

use crate::control::Control;
use crate::store::Store;
use axum::extract::ws::{Message, Utf8Bytes, WebSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

/// How often a viewer is given what is new.
const EVERY: Duration = Duration::from_millis(50);
/// A message to a viewer is at most about this long.
const BATCH_BYTES: usize = 1 << 20;
/// A viewer farther behind than this is told to load again from the start, which is faster.
const MAX_BEHIND_BYTES: usize = 32 << 20;
/// A browser that takes nothing for this long is gone.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);

/// Counts a viewer while it is there.
pub(crate) struct Viewer(Arc<AtomicUsize>);

impl Viewer {
    pub(crate) fn new(n_viewers: &Arc<AtomicUsize>) -> Self {
        n_viewers.fetch_add(1, Ordering::Relaxed);
        Self(Arc::clone(n_viewers))
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Sends the messages from number `from` on until the run is over or the viewer is gone. `{"control": ...}` tells the state
/// of the gate, `{"reload": true}` that the viewer is too far behind, `{"over": true}` that this was all.
pub(crate) async fn serve(
    mut socket: WebSocket,
    store: Arc<Store>,
    control: Option<Arc<Control>>,
    mut from: usize,
    is_closing: Arc<AtomicBool>,
    _viewer: Viewer,
) {
    let mut version = None;
    let mut is_over = false;
    loop {
        if let Some(control) = &control
            && version != Some(control.version())
        {
            version = Some(control.version());
            let state = serde_json::json!({"control": control.to_json()}).to_string();
            if !send(&mut socket, state).await {
                return;
            }
        }
        let batch = store.since(from, BATCH_BYTES);
        from = batch.next;
        if batch.n > 0 {
            // Lines of the store are JSON, thus text.
            let Ok(lines) = String::from_utf8(batch.lines) else { return };
            if !send(&mut socket, lines).await {
                return;
            }
            if store.backlog(from) > MAX_BEHIND_BYTES {
                send(&mut socket, r#"{"reload":true}"#.to_owned()).await;
                return;
            }
            continue;
        }
        if (batch.is_end || is_closing.load(Ordering::Relaxed)) && !is_over {
            is_over = true;
            if !send(&mut socket, r#"{"over":true}"#.to_owned()).await {
                return;
            }
        }
        if is_closing.load(Ordering::Relaxed) {
            drop(tokio::time::timeout(SEND_TIMEOUT, socket.send(Message::Close(None))).await);
            return;
        }
        // Nothing is expected of the viewer but its going.
        if let Ok(None | Some(Err(_) | Ok(Message::Close(_)))) = tokio::time::timeout(EVERY, socket.recv()).await {
            return;
        }
    }
}

async fn send(socket: &mut WebSocket, text: String) -> bool {
    let sent = tokio::time::timeout(SEND_TIMEOUT, socket.send(Message::Text(Utf8Bytes::from(text)))).await;
    matches!(sent, Ok(Ok(())))
}
