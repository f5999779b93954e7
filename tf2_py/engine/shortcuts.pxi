# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Methods in Python with a shortcut in C for the usual arguments of a lookup.

A function in Python that only calls another method would take a fifth of a lookup's time. A compiled
method instead of it would not be to programs what tf2's is: the stand-ins of ``unittest.mock`` get ``self``,
and know their arguments, only if they stand for a function. So a Shortcut has the attributes of the function
that it stands for, also its ``__class__``, by which ``isinstance`` and ``inspect`` take it for a function, as
they take the stand-ins of ``mock`` for what these stand for.
"""

cdef extern from "Python.h":
    ctypedef struct CallableType "PyTypeObject":
        unsigned long tp_flags
        Py_ssize_t tp_vectorcall_offset
        void* tp_call
    unsigned long Py_TPFLAGS_HAVE_VECTORCALL
    unsigned long Py_TPFLAGS_METHOD_DESCRIPTOR
    void PyType_Modified(PyTypeObject* cls)
    int Py_EnterRecursiveCall(const char* where)    # 1 or -1: it has set an error
    void Py_LeaveRecursiveCall()
    object PyMethod_New(object function, object instance)
    object PyVectorcall_Call(object callable, object args, object kwargs)
    Py_ssize_t PyVectorcall_NARGS(size_t count)
    object PyObject_Vectorcall(object callable, PyObject* const* args, size_t count, PyObject* names)
    PyObject* PyObject_VectorcallMethod(object name, PyObject* const* args, size_t count, PyObject* names)

cdef extern from *:
    """
    #define tf2_as_object(found) (found)
    """
    # Takes the new reference; if it is NULL, the error that is set is raised.
    object tf2_as_object(PyObject* found)

cdef enum:
    USUAL = 4       # self, target_frame, source_frame, time

# What a Shortcut must answer itself: as that of the function, it would be another object.
cdef frozenset OWN = frozenset("__call__ __eq__ __ge__ __get__ __gt__ __hash__ __le__ __lt__ __ne__".split())


@cython.final
cdef class Shortcut:
    # Stands for `function` in a class. A call with nothing but the frames and the time becomes a call of
    # `core`, a method of the same object, by name, so that overriding it has an effect.
    cdef void* vectorcall               # what CPython calls: see _make_callable
    cdef object function
    cdef object core
    cdef object default                 # of its `timeout`
    cdef bint is_pair                   # `core` returns a pair, and the method its first part, as a bool
    cdef object __weakref__

    def __init__(self, function, str core, bint is_pair):
        self.vectorcall = <void*>_call
        self.function, self.core, self.is_pair = function, sys.intern(core), is_pair
        self.default = function.__defaults__[0]

    def __get__(self, instance, owner):
        return self if instance is None else PyMethod_New(self, instance)

    def __call__(self, *arguments, **options):
        # Not by CPython, see _make_callable, but by those who look for the attribute.
        return self.function(*arguments, **options)

    def __getattribute__(self, name):
        if name == "__signature__":
            return _signature(self.function)
        return object.__getattribute__(self, name) if name in OWN else getattr(self.function, name)

    def __setattr__(self, name, value):
        setattr(self.function, name, value)

    def __delattr__(self, name):
        delattr(self.function, name)

    def __repr__(self):
        return repr(self.function)


cdef object _call(PyObject* called, PyObject* const* args, size_t count, PyObject* names):
    cdef Shortcut self = <Shortcut>called
    cdef Py_ssize_t given = PyVectorcall_NARGS(count)
    if names != NULL or not (given == USUAL or given == USUAL + 1 and args[USUAL] == <PyObject*>self.default):
        return PyObject_Vectorcall(self.function, args, count, names)
    # The core may be this again.
    cdef PyObject* found = NULL
    if Py_EnterRecursiveCall(" while calling a method that looks up") == 0:
        found = PyObject_VectorcallMethod(self.core, args, USUAL, NULL)
        Py_LeaveRecursiveCall()
    answer = tf2_as_object(found)
    if self.is_pair:
        can, _ = answer
        return bool(can)
    return answer


cdef object _signature(function):
    # With the options by their names. The function has them as **policy, to say more of a name that is wrong.
    import inspect

    from tf2_py.typing import LookupPolicy      # needs NumPy
    signature = inspect.signature(function)
    *parameters, _ = signature.parameters.values()
    named = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation,
                          default=False if annotation is bool else None)
        for name, annotation in LookupPolicy.__annotations__.items()
    ]
    return signature.replace(parameters=parameters + named)


cdef int _make_callable() except -1:
    # By CPython's protocol "vectorcall", which Cython offers for functions alone. The second flag saves an
    # object for each call: the method that binds it to `self`.
    cdef CallableType* cls = <CallableType*>Shortcut
    cdef Shortcut any_one = Shortcut.__new__(Shortcut)
    cls.tp_vectorcall_offset = <char*>&any_one.vectorcall - <char*><PyObject*>any_one
    cls.tp_call = <void*>PyVectorcall_Call
    cls.tp_flags |= Py_TPFLAGS_HAVE_VECTORCALL | Py_TPFLAGS_METHOD_DESCRIPTOR
    PyType_Modified(<PyTypeObject*>cls)
    return 0


_make_callable()
# As a function: by its name.
copyreg.pickle(Shortcut, operator.attrgetter("__qualname__"))


def shortcut(str core, bint is_pair=False):
    """
    Let a method that looks up call ``core``, a method with three arguments, if nothing else is given.

    :param is_pair: ``core`` returns a pair; the method returns whether its first part is true.
    """
    return lambda function: Shortcut(function, core, is_pair)
