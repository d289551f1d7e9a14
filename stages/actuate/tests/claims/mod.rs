mod broken;
mod codec;
mod keys;
mod lives;
mod sent;
