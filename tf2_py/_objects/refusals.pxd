"""Why every buffer refuses a transform."""

from tf2_py._core.types cimport Incoming

# None: no buffer refuses it, or only for what it holds already. Changes `incoming` as incoming_refusals does.
cdef str refusal_text(Incoming* incoming)
