//! The whole suite again, on chips that behave otherwise where the datasheet is silent; `rig/chip.rs` reads which one
//! from the modules' names; and on the ADS131M04 with its four channels. The suite itself runs on an ADS131M02 that looks at
//! STATUS as a frame starts, and resets as chip select rises.
#![allow(clippy::duplicate_mod, reason = "that is what this file is for")]

#[path = "commands.rs"]
mod commands_status_at_frame_end;
#[path = "conservation.rs"]
mod conservation_status_at_frame_end;
#[path = "forces.rs"]
mod forces_status_at_frame_end;
#[path = "inputs.rs"]
mod inputs_status_at_frame_end;
#[path = "links.rs"]
mod links_status_at_frame_end;
#[path = "orders.rs"]
mod orders_status_at_frame_end;
#[path = "stream.rs"]
mod stream_status_at_frame_end;
#[path = "threads.rs"]
mod threads_status_at_frame_end;

#[path = "commands.rs"]
mod commands_reset_at_last_clock;
#[path = "conservation.rs"]
mod conservation_reset_at_last_clock;
#[path = "forces.rs"]
mod forces_reset_at_last_clock;
#[path = "inputs.rs"]
mod inputs_reset_at_last_clock;
#[path = "links.rs"]
mod links_reset_at_last_clock;
#[path = "orders.rs"]
mod orders_reset_at_last_clock;
#[path = "stream.rs"]
mod stream_reset_at_last_clock;
#[path = "threads.rs"]
mod threads_reset_at_last_clock;

#[path = "commands.rs"]
mod commands_status_at_frame_end_reset_at_last_clock;
#[path = "conservation.rs"]
mod conservation_status_at_frame_end_reset_at_last_clock;
#[path = "forces.rs"]
mod forces_status_at_frame_end_reset_at_last_clock;
#[path = "inputs.rs"]
mod inputs_status_at_frame_end_reset_at_last_clock;
#[path = "links.rs"]
mod links_status_at_frame_end_reset_at_last_clock;
#[path = "orders.rs"]
mod orders_status_at_frame_end_reset_at_last_clock;
#[path = "stream.rs"]
mod stream_status_at_frame_end_reset_at_last_clock;
#[path = "threads.rs"]
mod threads_status_at_frame_end_reset_at_last_clock;

#[path = "commands.rs"]
mod commands_four_channels;
#[path = "conservation.rs"]
mod conservation_four_channels;
#[path = "forces.rs"]
mod forces_four_channels;
#[path = "inputs.rs"]
mod inputs_four_channels;
#[path = "links.rs"]
mod links_four_channels;
#[path = "orders.rs"]
mod orders_four_channels;
#[path = "stream.rs"]
mod stream_four_channels;
#[path = "threads.rs"]
mod threads_four_channels;
