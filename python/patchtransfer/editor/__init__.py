"""The studio: a page or a notebook's cell in which a target is dragged, and the certified result follows.

`editing` moves points of outlines, `session` keeps what is edited and its result, `view` turns both into what the page
draws, `messages` checks what the page says, `server` is the only module that knows of sockets, `widget` the only one
that knows of notebooks. The room is not called studio, for that is the name of the function, `patchtransfer.studio`.
"""
