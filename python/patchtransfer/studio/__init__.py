"""The studio: a local page in which a target is dragged, and the certified result follows.

`editing` moves points of outlines, `session` keeps what is edited and its result, `view` turns both into what the page
draws, `messages` checks what the page says, `server` is the only module that knows of sockets.
"""
